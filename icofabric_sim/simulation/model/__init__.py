# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What kernels read: a scene packed into arrays, and what follows from them."""
