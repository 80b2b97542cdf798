# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""One step after the other: methods, step-size control, events, monitor."""
