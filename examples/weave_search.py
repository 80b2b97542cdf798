# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Search for the weave with the largest shear stiffness C44 per mass that is still stiff enough.

    .venv/bin/python examples/weave_search.py --least 500

An open weave weighs little, so C44 over density grows with the connector angle without end; what
ends it is the least C44 [Pa] that is wanted. SciPy's differential evolution asks for a whole
generation at a time, which the workers share; a second call takes all of it from the store.
"""

import argparse

from distributed import LocalCluster
import icofabric_sim as ico
import numpy as np
from scipy.optimize import differential_evolution

BASE = {'weave.size': [3, 3, 3], 'connector.stiffness': 500.0,
        'connector.bending_stiffness': 0.02}
# Connector angle [rad], and attachment points over the middles of edges.
NAMES = ('weave.connector_angle', 'connector.attachment_scale')
BOUNDS = [(0.1, 0.75), (0.8, 1.2)]
# Cost of a weave without a result.
_WORST = 1e12


def shear_stiffness(points, **where):
    """C44 [Pa] and density [kg/m^3] of weaves (m, 2), found by one study."""
    table = ico.sweep(
        ico.Scene.from_parameters(BASE),
        cases=[dict(zip(NAMES, map(float, point))) for point in points],
        verbs='elasticity', **where)
    return table['elasticity.stiffness.yz.yz'], table['elasticity.density']


def search(least, *, population=8, generations=20, **where):
    """
    Return the best weave with a C44 of at least `least` [Pa].

    Returns its angle and scale, its C44 [Pa] and density [kg/m^3], and how many weaves were tried.
    """
    tried = []

    def cost(columns):
        stiffness, density = shear_stiffness(columns.T, **where)
        tried.append(len(density))
        # What is too soft costs the more the softer it is.
        lacking = np.maximum(1.0 - stiffness / least, 0.0)
        value = -stiffness / density + 1e6 * lacking
        # Nothing is known of a run that has failed.
        return np.where(np.isfinite(value), value, _WORST)

    found = differential_evolution(
        cost, BOUNDS, popsize=population, maxiter=generations, tol=1e-8, rng=1, polish=False,
        vectorized=True, updating='deferred', init='sobol')
    [stiffness], [density] = shear_stiffness([found.x], **where)
    return found.x, float(stiffness), float(density), sum(tried)


def main():
    """Search on all cores."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--least', type=float, default=500.0, help='least C44 [Pa]')
    parser.add_argument('--generations', type=int, default=20)
    arguments = parser.parse_args()
    # One cluster for all generations.
    with LocalCluster(
            threads_per_worker=1, dashboard_address='127.0.0.1:0', silence_logs=50) as cluster:
        (angle, scale), stiffness, density, tried = search(
            arguments.least, generations=arguments.generations,
            scheduler=cluster.scheduler_address)
    if stiffness < arguments.least:
        print(f'none of them is as stiff as {arguments.least:g} Pa; the nearest:')
    print(f'connector angle {angle:.4f} rad, attachment scale {scale:.4f}: C44 {stiffness:.5g} '
          f'Pa, density {density:.4g} kg/m^3, C44 per density {stiffness / density:.5g} m^2/s^2; '
          f'{tried:,} weaves were tried')


# Workers import this file.
if __name__ == '__main__':
    main()
