# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Planes that move on prescribed paths, and the work of the paths.

A moving plane has a carrier: a slot without mass whose position is the displacement of the plane.
Its path is one of `Drives`. Contacts push on it as on a body, and the path bears these forces.
"""
