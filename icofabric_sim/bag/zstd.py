# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""The zstd of the standard library, or the package that brings it to older Pythons."""
import sys

if sys.version_info >= (3, 14):
    from compression.zstd import compress, decompress, ZstdFile
else:
    from backports.zstd import compress, decompress, ZstdFile

__all__ = ['compress', 'decompress', 'ZstdFile']
