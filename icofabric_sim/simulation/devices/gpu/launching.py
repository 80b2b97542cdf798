# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""What whoever launches on a device does first: take turns, and name what fails."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import RLock

from icofabric_sim.simulation.errors import DeviceError

# What is launched or copied while a thread records a graph would be recorded, too.
TURN = RLock()


@contextmanager
def named_failure(device: str, forget: Callable[[], None]) -> Iterator[None]:
    """Let what goes wrong be a failure of the `device`; the state there is lost: `forget` it."""
    try:
        yield
    except Exception as error:
        forget()
        raise DeviceError(f'{device} has failed: {error}') from error
