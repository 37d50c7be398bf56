"""Parts of a deck: the facets that carry what acts at nodes."""

from pathlib import Path

import numpy as np
import pytest

from ddmpi.decks.cards import Block, Card
from ddmpi.decks.pieces import Piece, connected, cut, rows_of

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
    carried = np.concatenate([nodes for _, nodes, _ in found])
    assert np.sort(np.append(carried, left)).tolist() == loaded
    assert not len(left)
    for facets, nodes, _ in found:
        assert np.isin(nodes, piece.facets[facets]).all()


@pytest.mark.parametrize("swapped", [(0, 15), (0, 4), (1, 4), (0, 5), (0, 9)])
def test_a_ring_that_is_cut_at_a_face_opens_there(swapped):
    """Of nine squares without the middle one, whatever the numbers of the nodes: beside the cut a layer is taken out,
    which is a piece of its own then."""
    number = np.arange(16)
    number[[*swapped]] = number[[*swapped[::-1]]]
    squares = np.array([[k, k + 1, k + 5, k + 4] for k in range(11) if k % 4 < 3 and k != 5])
    points = np.array([[x, y] for y in (0.0, 0.7, 1.9, 3.0) for x in (0.0, 1.1, 1.9, 3.3)])
    card = Card("ELEMENT", {"TYPE": "CPS4"}, [], 1, Path("deck.inp"), "ELEMENT")
    entries = np.column_stack([np.arange(1, 9), 1 + number[squares]])
    places = np.empty_like(points)
    places[number] = points
    blocks = [Block("quad", entries, card)]
    rows = rows_of(blocks)
    # the face of the first square towards the second one
    apart, section, around = cut(blocks, rows, {(1, 2)}, np.arange(1, 17), places)
    assert sorted(section) == sorted(1 + number[[1, 5]])
    assert len(set(around)) == 2
    piece = connected(apart)
    assert (piece[1:] == piece[1]).all() and piece[0] != piece[1]
