# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Random scenes, judged from outside: what `icofabric stress` runs.

`kinds.py` lists the kinds of scenes, `scenes.py` draws a scene from a seed, `judge.py` runs and
classes it, `workers.py` does so in other processes, `shrink.py` makes a scene minimal.
"""
