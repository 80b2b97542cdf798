# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Parameter studies: many runs of one scene that differ in some parameters.

`plan` says which runs; `outcomes` what is kept of each; `run_key` names a run by all that it
depends on; `store` keeps what is done; `single_run` does one; `dask_runs` hands runs to the
workers of Dask; `table` has the results; `sweep` is the way in.
"""
