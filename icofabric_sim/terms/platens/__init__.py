# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Planes that move on prescribed paths.

A moving plane has a carrier: a slot without a body, whose position is the displacement of the
plane. Its path is one of `Drives`. Contacts push on the carrier as on a body, and the path bears
these forces. The mass of a carrier is 0, so it has no energy. Its inverse mass is -1/kg, so that
its accelerations are minus the forces on it, which steps of one length keep from one kick to the
next. Gravity acts only where inverse masses are positive.
"""
