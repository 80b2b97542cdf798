# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Frame names of bodies, which are also their names as entities."""

import re

# frame_id of a wrench in body axes that acts on every body of a channel; prefix of frame names.
ANY_BODY = 'icosahedron'
_BODY = re.compile(rf'{ANY_BODY}_(0|[1-9][0-9]{{0,9}})')
_MAX_SHOWN_LENGTH = 100


def body_frame(body: int) -> str:
    """Return the frame name of a body."""
    return f'{ANY_BODY}_{body}'


def parse_body_frame(frame_id: str) -> int | None:
    """Return the body number in a frame name, also of unknown bodies; None for other names."""
    match = _BODY.fullmatch(frame_id)
    return None if match is None else int(match[1])


def shown_frame(frame_id: str) -> str:
    """Return a frame name for an error message, shortened if long."""
    cut = frame_id if len(frame_id) <= _MAX_SHOWN_LENGTH else f'{frame_id[:_MAX_SHOWN_LENGTH]}...'
    return repr(cut)
