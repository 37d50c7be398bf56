"""Parts of a deck: the facets that carry what acts at nodes."""

from pathlib import Path

import numpy as np
import pytest

from ddmpi.decks.cards import Block, Card
from ddmpi.decks.pieces import Piece

SQUARES = np.array([[1, 2, 5, 4], [2, 3, 6, 5]])
"""Nodes of two squares side by side."""

POINTS = np.array([[x, y] for y in (0.0, 1.3) for x in (0.0, 0.7, 1.9)])


@pytest.mark.parametrize("loaded", [[0], [0, 1], [0, 1, 2], [0, 5], [2, 5], [0, 1, 2, 3, 4, 5]])
def test_facets_carry_the_forces_at_all_loaded_nodes_once(loaded):
    """Of the first node as of others: at whole facets, or at those around a node."""
    card = Card("ELEMENT", {"TYPE": "CPS4"}, [], 1, Path("deck.inp"), "ELEMENT")
    entries = np.column_stack([[1, 2], SQUARES])
    piece = Piece("part", [Block("quad", entries, card)], np.arange(1, 7), POINTS)
    found, left = piece.patches(np.array(loaded))
    carried = np.concatenate([nodes for _, nodes in found])
    assert np.sort(np.append(carried, left)).tolist() == loaded
    assert not len(left)
    for facets, nodes in found:
        assert np.isin(nodes, piece.facets[facets]).all()
