# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""What kernels read: a scene packed into arrays, and what follows from them."""
