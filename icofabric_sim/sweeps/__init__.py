# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Parameter sweeps: many runs of one scene that differ in some parameters.

`plan` lists the runs; `outcomes` extracts the results of a run; `run_key` computes its key;
`store` holds finished runs; `single_run` computes one run; `dask_runs` distributes runs to Dask
workers; `table` collects the results; `sweep` is the public entry point.
"""
