# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Browser page that shows a fabric and lets the mouse drag shells; needs the extra `viewer`."""
