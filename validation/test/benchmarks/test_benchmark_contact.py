# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark of contact places its pairs as it says; no wall times here."""

import csv
import importlib.util

from icofabric_sim.terms.contacts.many import signed_distances
from icofabric_validation.benchmarks import contact, contact_report
from icofabric_validation.benchmarks.contact_pairs import families, HALF_EDGE
import numpy as np
import pytest


def test_pairs_are_as_far_apart_as_they_say():
    near, close, shallow, flat, far = families(200)
    found = []
    for pairs in (near, close, shallow, flat, far):
        distance, axis = np.zeros(200), np.zeros((200, 3))
        signed_distances(np.full((200, 2), HALF_EDGE), *pairs[1:], distance, axis)
        found.append(distance / HALF_EDGE)
    near, close, shallow, flat, far = found
    assert 0.2 < (near < 0.0).mean() < 0.6 and near.max() < 0.8
    assert close.min() > -1e-12 and 0.05 < close.max() <= 0.1
    assert shallow.max() < 1e-12 and -0.01 <= shallow.min() < -0.004
    assert flat.max() < 1e-12 and -0.01 <= flat.min() < -0.004
    assert far.min() > 6.0


def test_from_end_to_end(tmp_path):
    installed = importlib.util.find_spec(contact.LIBRARY) is not None
    result = contact.measure(rounds=2, count=50)
    assert len(result.rows) == 5 * (5 if installed else 3)
    assert all(len(row.times) == 2 and min(row.times) > 0.0 for row in result.rows)
    assert sorted(share in (0.0, 1.0) for share in result.touching.values()) == [
        False, True, True, True, True]
    text = '\n'.join(contact_report.lines(result))
    if installed:
        assert result.compared == 250 and result.missed == 0
        assert '0 of 250 pairs' in text and contact.COLLIDE in text
    else:
        assert result.missing in text
    path, = contact_report.write(result, tmp_path)
    with open(path, newline='') as file:
        assert len(list(csv.DictReader(file))) == len(result.rows)


def test_without_the_library(monkeypatch):
    def refuse(name):
        raise ImportError(name)

    monkeypatch.setattr(contact, 'import_module', refuse)
    result = contact.measure(rounds=1, count=20)
    assert 'pip install coal' in contact_report.lines(result)[-1] and len(result.rows) == 15
    alone = contact.measure(library=False, rounds=1, count=20)
    assert alone.missing == '' and alone.ratio(alone.rows[0].family, contact.FORCE, 'coal') is None
    assert contact_report.lines(alone)[-1] != ''
    with pytest.raises(StopIteration):
        next(row for row in alone.rows if 'coal' in row.what)
