# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Objects that are closed at the end of a `with` block."""

from typing import Self


class Closing:
    """Base class of context managers that end with a call of `close`."""

    def close(self) -> object:
        """Release all resources; a second call has no effect."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
