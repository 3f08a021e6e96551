"""Neighbours: every pair within reach, whatever the sizes."""

import numpy as np
import pytest

from pybondem.errors import InputError
from pybondem.neighbours import MOST_BONDS, listed, own_bonds, pairs_within


@pytest.mark.parametrize("sizes", [[0.03], [0.01, 0.03, 0.2], [0.004, 0.3]])
def test_pairs_are_those_of_a_search_of_all_pairs(sizes):
    random = np.random.default_rng(1)
    x, radius = random.uniform(size=(250, 3)), random.choice(sizes, 250)
    apart = np.linalg.norm(x[:, None] - x[None], axis=2)
    expected = np.argwhere(np.triu(apart <= 1.05 * (radius[:, None] + radius[None]), 1))
    assert len(expected) > 20
    assert np.array_equal(pairs_within(x, radius, 0.05), expected)


def test_own_bonds_list_every_end_once_in_ascending_order():
    i, j = np.array([0, 0, 2], np.uint32), np.array([1, 2, 3], np.uint32)
    first, ends = own_bonds(i, j, 5)
    assert first.tolist() == [0, 2, 3, 5, 6, 6]
    assert ends.tolist() == [0, 2, 1, 3, 4, 5]  # 2 * bond + side


def test_more_bonds_than_their_lists_can_name_are_refused():
    """The last end that can be named is 2 * bond + 1 of the last bond that is let through."""
    listed(MOST_BONDS - 1)
    assert np.iinfo(np.uint32).max == 2 * (MOST_BONDS - 1) + 1
    with pytest.raises(InputError, match=r"has 2,147,483,648 bonds; it must have fewer than 2,147,483,648"):
        listed(MOST_BONDS)


def test_lists_of_own_bonds_hold_to_what_they_can_name(monkeypatch):
    monkeypatch.setattr("pybondem.neighbours.MOST_BONDS", 3)
    i, j = np.array([0, 0, 2], np.uint32), np.array([1, 2, 3], np.uint32)
    assert len(own_bonds(i[:2], j[:2], 5)[1]) == 4
    with pytest.raises(InputError, match="has 3 bonds"):
        own_bonds(i, j, 5)
