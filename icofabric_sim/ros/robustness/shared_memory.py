# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Size of the shared-memory segment for published messages.

Fast DDS passes messages to processes on the same machine through a segment of 512 kB, unless a
profile sets another size. The poses and markers of a thousand bodies fill it, and unread messages
of a killed or stopped subscriber stay in it for a while. Healthy subscribers then received nothing
for up to 12 s. With a larger segment the longest gap was 0.1 s (docs/reliability.md).
"""

import os
from pathlib import Path
import tempfile

# Nothing is changed if the user has set one of these.
_USER_VARIABLES = (
    'FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE',
    'FASTDDS_BUILTIN_TRANSPORTS')
_USER_FILES = ('DEFAULT_FASTRTPS_PROFILES.xml', 'DEFAULT_FASTDDS_PROFILES.xml')
_FOLDER = '/dev/shm'
# Unused pages take no memory.
_SEGMENT_BYTES = 2**25  # bytes
# If shared memory is scarce (a container may have 64 MB), use only this fraction of the free
# space, as a divisor.
_FREE_SPACE_DIVISOR = 8
_DEFAULT_SEGMENT_BYTES = 2**19

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
    """Larger shared-memory segment for the participants of this process, where possible."""

    def __init__(self) -> None:
        """
        Write a Fast DDS profile; call before the first node of the process is created.

        `size` [bytes] is 0 if the user has a profile or space is insufficient.
        """
        self._profile: Path | None = None
        self.size = 0
        if any(name in os.environ for name in _USER_VARIABLES) or any(
                map(os.path.exists, _USER_FILES)):
            return
        size = min(_SEGMENT_BYTES, _free_bytes() // _FREE_SPACE_DIVISOR)
        if size <= _DEFAULT_SEGMENT_BYTES:
            return
        try:
            descriptor, name = tempfile.mkstemp('.xml', 'icofabric_')
            with open(descriptor, 'w') as file:
                file.write(_PROFILE.format(size=size))
        except OSError:
            # No writable folder: use the default segment.
            return
        self._profile, self.size = Path(name), size
        os.environ[_USER_VARIABLES[0]] = name

    def close(self) -> None:
        """Remove the profile file; the first node has read it."""
        if self._profile is not None:
            self._profile.unlink(missing_ok=True)
            os.environ.pop(_USER_VARIABLES[0], None)
            self._profile = None


def _free_bytes() -> int:
    try:
        figures = os.statvfs(_FOLDER)
    except OSError:
        return 0
    return figures.f_bavail * figures.f_frsize
