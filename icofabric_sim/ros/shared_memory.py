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
"""
Room in shared memory for what a node publishes.

Fast DDS hands messages to processes on the same machine through a segment of 512 kB, unless a
profile says otherwise. The poses and markers of a thousand bodies fill it, and what a subscriber
that was killed or stopped had not read keeps its place for a while: healthy subscribers then
heard nothing at all for up to 12 s. With a larger segment the longest gap was 0.1 s
(docs/reliability.md).
"""

import os
from pathlib import Path
import tempfile

# Where users have set these, nothing is changed.
_OWN_SETTINGS = (
    'FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE',
    'FASTDDS_BUILTIN_TRANSPORTS')
_OWN_FILES = ('DEFAULT_FASTRTPS_PROFILES.xml', 'DEFAULT_FASTDDS_PROFILES.xml')
_FOLDER = '/dev/shm'
# Pages that are never written to take no memory.
_SEGMENT = 2**25  # bytes
# Where shared memory is scarce (a container may have 64 MB), only this part of what is left.
_PART = 8
_DEFAULT_SEGMENT = 2**19

_PROFILE = """<?xml version="1.0" encoding="UTF-8" ?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <transport_descriptors>
    <transport_descriptor>
      <transport_id>icofabric_shm</transport_id>
      <type>SHM</type>
      <segment_size>{size}</segment_size>
    </transport_descriptor>
    <transport_descriptor>
      <transport_id>icofabric_udp</transport_id>
      <type>UDPv4</type>
    </transport_descriptor>
  </transport_descriptors>
  <participant profile_name="icofabric" is_default_profile="true">
    <rtps>
      <userTransports>
        <transport_id>icofabric_shm</transport_id>
        <transport_id>icofabric_udp</transport_id>
      </userTransports>
      <useBuiltinTransports>false</useBuiltinTransports>
    </rtps>
  </participant>
</profiles>
"""


class SharedMemory:
    """A larger segment for the participants of this process, wherever that is possible."""

    def __init__(self) -> None:
        """
        Ask Fast DDS for it; before the first node of the process is created.

        `size` [bytes] is 0 where users have settings of their own, or there is no room.
        """
        self._profile: Path | None = None
        self.size = 0
        if any(name in os.environ for name in _OWN_SETTINGS) or any(
                map(os.path.exists, _OWN_FILES)):
            return
        size = min(_SEGMENT, _free() // _PART)
        if size <= _DEFAULT_SEGMENT:
            return
        try:
            descriptor, name = tempfile.mkstemp('.xml', 'icofabric_')
            with open(descriptor, 'w') as file:
                file.write(_PROFILE.format(size=size))
        except OSError:
            # Nowhere to write a file: what is usual has to do.
            return
        self._profile, self.size = Path(name), size
        os.environ[_OWN_SETTINGS[0]] = name

    def close(self) -> None:
        """Remove the file, which has been read once there is a node."""
        if self._profile is not None:
            self._profile.unlink(missing_ok=True)
            os.environ.pop(_OWN_SETTINGS[0], None)
            self._profile = None


def _free() -> int:
    try:
        figures = os.statvfs(_FOLDER)
    except OSError:
        return 0
    return figures.f_bavail * figures.f_frsize
