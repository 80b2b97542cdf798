# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Coefficients of the pair of order 5(4) by Tsitouras and of its dense output of order 4.

Source: Tsitouras 2011, Runge-Kutta pairs of order 5(4) satisfying only the first column
simplifying assumption, Computers and Mathematics with Applications 62, 770.
"""

from icofabric_sim.kernels.integrators.tableau import Tableau

TABLEAU = Tableau(
    stages=(
        (),
        (0.161,),
        (-0.008480655492356989, 0.335480655492357),
        (2.8971530571054935, -6.359448489975075, 4.3622954328695815),
        (5.325864828439257, -11.748883564062828, 7.4955393428898365, -0.09249506636175525),
        (5.86145544294642, -12.92096931784711, 8.159367898576159, -0.071584973281401,
         -0.028269050394068383)),
    step=(
        0.09646076681806523, 0.01, 0.4798896504144996, 1.379008574103742, -3.290069515436081,
        2.324710524099774),
    # The formula of order 4 has a weight of the slope at the end, too.
    higher_error=(
        -0.00178001105222577714, -0.0008164344596567469, 0.007880878010261995,
        -0.1447110071732629, 0.5823571654525552, -0.45808210592918697, 1.0 / 66.0),
    lower_error=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    error_order=4,
    dense_stages=(),
    dense=((
        -1.0530884977290216, 0.1017, 2.4906272856512528, -16.548102889244902, 47.37952196281928,
        -34.87065786149661, 2.5),),
    # The error was less than a tenth of this estimate in the scenes of docs/decisions/accuracy.md.
    estimate_ratio=1.0,
    probable_ratio=0.1)
