# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Parameter studies: many runs of one scene that differ in some parameters.

`plan` says which runs; `outcomes` what is kept of each; `run_key` names a run by all that it
depends on; `store` keeps what is done; `single_run` does one; `dask_runs` hands runs to the
workers of Dask; `table` has the results; `sweep` is the way in.
"""
