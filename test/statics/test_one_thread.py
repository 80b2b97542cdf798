# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Dense linear algebra of statics runs in one thread, and others get theirs back."""

from icofabric_sim.statics import one_thread as threads
import numpy as np
import pytest


def test_one_thread_inside_and_as_before_after_it():
    matrix = np.eye(3)
    before = [ask() for ask, _ in threads._libraries()]
    if not before:
        pytest.skip('numpy and scipy have no OpenBLAS here')
    with pytest.raises(ValueError):
        with threads.one_thread():
            assert [ask() for ask, _ in threads._libraries()] == [1] * len(before)
            assert np.linalg.eigvalsh(matrix) == pytest.approx(np.ones(3))
            raise ValueError
    assert [ask() for ask, _ in threads._libraries()] == before


def test_other_libraries_are_left_alone(monkeypatch):
    monkeypatch.setattr(threads, '_NAMES', (('no_such_name', 'nor_this'),))
    assert threads._libraries() == ()
    with threads.one_thread():
        assert np.linalg.eigvalsh(np.eye(2)) == pytest.approx(np.ones(2))
