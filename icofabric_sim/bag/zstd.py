# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""zstd of the standard library, or of the package that provides it for older Pythons."""
import sys

if sys.version_info >= (3, 14):
    from compression.zstd import compress, decompress, ZstdFile
else:
    from backports.zstd import compress, decompress, ZstdFile

__all__ = ['compress', 'decompress', 'ZstdFile']
