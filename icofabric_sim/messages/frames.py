# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""Names of the frames of bodies, which are also their names as entities."""

import re

# The axes of each body of a channel in turn.
ANY_BODY = 'icosahedron'
_BODY = re.compile(rf'{ANY_BODY}_(0|[1-9][0-9]{{0,9}})')
_LONGEST_SHOWN = 100


def body_frame(body: int) -> str:
    """Name of the frame of a body."""
    return f'{ANY_BODY}_{body}'


def parse_body_frame(frame_id: str) -> int | None:
    """The body of a frame, whether a scene has it or not; None for any other name."""
    match = _BODY.fullmatch(frame_id)
    return None if match is None else int(match[1])


def shown_frame(frame_id: str) -> str:
    """A frame as an error may hold it, whatever its length."""
    cut = frame_id if len(frame_id) <= _LONGEST_SHOWN else f'{frame_id[:_LONGEST_SHOWN]}...'
    return repr(cut)
