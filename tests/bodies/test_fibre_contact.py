"""Contacts of fibres: nearest places of polylines, counted once, with names that last; and with bodies by their distance."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.bodies.fibres.contact import FibreContacts, Layout, fibre_contacts
from barchan.bodies.fibres.obstacles import obstacle_contacts
from barchan.bodies.rigid import Body, BodyStates, Box, Fixed, HalfSpace, Prescribed, Sphere
from barchan.errors import InputError

RADIUS = 0.01


def wild(seed: int, counts: tuple[int, ...] = (6, 9, 4)) -> tuple[Layout, np.ndarray]:
    """Random polylines in a box of side 1."""
    rng = np.random.default_rng(seed)
    lines = [rng.random(3) + np.cumsum(0.12 * rng.normal(size=(n, 3)), axis=0) for n in counts]
    layout = Layout(np.concatenate([[0], np.cumsum(counts)]), np.full(len(counts), RADIUS))
    return layout, np.concatenate(lines)


def found_between(layout: Layout, nodes: np.ndarray, slack: float) -> FibreContacts:
    return fibre_contacts(layout, nodes, np.zeros_like(nodes), 1.0, slack)


def places(nodes: np.ndarray, layout: Layout, contacts: FibreContacts, side: int) -> np.ndarray:
    """(k, 3) points of the centre lines."""
    start = layout.node_offsets[contacts.fibres[:, side]] + contacts.segments[:, side]
    return nodes[start] + contacts.shares[:, side, None] * (nodes[start + 1] - nodes[start])


def least_distance(one: np.ndarray, two: np.ndarray) -> float:
    """Of two polylines, by many points on the first and exact projections on the second."""
    share = np.linspace(0.0, 1.0, 401)[:, None]
    points = np.concatenate([a + share * (b - a) for a, b in pairwise(one)])
    best = np.inf
    for a, b in pairwise(two):
        t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = min(best, float(np.min(np.linalg.norm(points - a - t[:, None] * (b - a), axis=1))))
    return best


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_nearest_places_of_two_fibres_are_a_contact(seed: int) -> None:
    layout, nodes = wild(seed)
    contacts = found_between(layout, nodes, 0.3)
    one, two = (places(nodes, layout, contacts, side) for side in (0, 1))
    way = one - two
    assert np.all(np.diff(contacts.keys) > 0)
    np.testing.assert_allclose(np.linalg.norm(way, axis=1) - 2 * RADIUS, contacts.gaps, atol=1e-12)
    np.testing.assert_allclose(way, (contacts.gaps + 2 * RADIUS)[:, None] * contacts.normals, atol=1e-12)
    np.testing.assert_allclose(contacts.points, 0.5 * (one + two), atol=1e-12)
    for i in range(3):
        for j in range(i + 1, 3):
            lines = [nodes[layout.node_offsets[k] : layout.node_offsets[k + 1]] for k in (i, j)]
            wanted = least_distance(*lines) - 2 * RADIUS
            here = np.all(contacts.fibres == (i, j), axis=1)
            if wanted <= 0.29:
                assert np.min(contacts.gaps[here]) == pytest.approx(wanted, abs=2e-3)
            pairs = np.concatenate([one[here], two[here]], axis=1)
            apart = np.linalg.norm(pairs[:, None] - pairs[None], axis=2) + np.eye(len(pairs))
            assert np.min(apart, initial=1.0) > 1e-9  # no place is counted twice


def test_a_contact_at_a_node_is_counted_once() -> None:
    lines = np.array([[-1.0, 0, 0], [0, 0, 0], [1, 0, 0], [0, -1, 0.02], [0, 0, 0.02], [0, 1, 0.02]])
    contacts = found_between(Layout(np.array([0, 3, 6]), np.full(2, RADIUS)), lines, 0.01)
    assert len(contacts) == 1
    np.testing.assert_allclose(contacts.normals[0], [0.0, 0.0, -1.0])
    assert contacts.gaps[0] == pytest.approx(0.0, abs=1e-15)


def test_fibres_side_by_side_touch_once_a_segment() -> None:
    line = np.column_stack([np.arange(6.0), np.zeros(6), np.zeros(6)])
    beside = line + np.array([0.0, 2 * RADIUS, 0.0])
    contacts = found_between(
        Layout(np.array([0, 6, 12]), np.full(2, RADIUS)), np.concatenate([line, beside]), 1e-3
    )
    assert contacts.segments.tolist() == [[k, k] for k in range(5)]
    np.testing.assert_allclose(contacts.shares, 0.5)


def test_a_fibre_touches_itself_only_when_it_comes_back() -> None:
    angle = np.linspace(0.0, 2.2 * np.pi, 60)
    helix = np.column_stack([np.cos(angle), np.sin(angle), 0.003 * angle])
    layout = Layout(np.array([0, 60]), np.array([RADIUS]))
    contacts = found_between(layout, helix, 0.0)
    assert len(contacts) > 0
    assert np.min(np.abs(np.diff(contacts.segments, axis=1))) > 50
    straight = np.column_stack(
        [0.005 * np.arange(60), np.zeros(60), np.zeros(60)]
    )  # segments shorter than the radius
    assert len(found_between(layout, straight, RADIUS)) == 0


def test_fibres_that_meet_within_the_step_are_found_and_their_roots_left_out() -> None:
    lines = np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 0.1], [0, 1, 0.1]])
    layout = Layout(np.array([0, 2, 4]), np.full(2, RADIUS))
    fast = np.zeros((4, 3))
    fast[2:, 2] = -1.0
    assert len(fibre_contacts(layout, lines, fast, 0.079, 0.0)) == 0
    assert len(fibre_contacts(layout, lines, fast, 0.081, 0.0)) == 1
    assert (
        len(fibre_contacts(layout, lines, fast + np.array([5.0, 0.0, 3.0]), 0.079, 0.0)) == 0
    )  # seen from a train
    assert len(fibre_contacts(layout, lines, fast, 0.081, 0.0, bare=1.01)) == 0


def against(body: Body, nodes: np.ndarray, slack: float, dt: float = 1.0) -> FibreContacts:
    layout = Layout(np.array([0, len(nodes)]), np.array([RADIUS]))
    still = np.zeros_like(nodes)
    blocks = np.zeros((1, 2, 3))
    return obstacle_contacts(layout, nodes, still, [body], BodyStates.at_start([body]), blocks, dt, slack)


def test_a_fibre_on_a_plane_touches_at_its_nodes() -> None:
    nodes = np.column_stack([0.1 * np.arange(5), np.zeros(5), np.full(5, RADIUS)])
    contacts = against(Body(HalfSpace([0.0, 0.0, 1.0]), motion=Fixed()), nodes, 1e-9)
    assert contacts.segments[:, 0].tolist() == [0, 1, 2, 3, 3]
    assert contacts.shares[:, 0].tolist() == [0.0, 0.0, 0.0, 0.0, 1.0]
    np.testing.assert_allclose(contacts.normals, np.tile([0.0, 0.0, 1.0], (5, 1)), atol=1e-12)
    np.testing.assert_allclose(contacts.points[:, 2], 0.0, atol=1e-12)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.05, 0.95), st.floats(0.2, 2.0))
def test_a_segment_on_a_sphere_touches_where_it_is_nearest(share: float, radius: float) -> None:
    ends = np.array([[-share, 0.0, 0.0], [1.0 - share, 0.0, 0.0]])
    body = Body(Sphere(radius), position=[0.0, 0.0, -radius - RADIUS - 1e-3], motion=Fixed())
    contacts = against(body, ends, 2e-3)
    near = int(np.argmin(contacts.gaps))
    assert contacts.shares[near, 0] == pytest.approx(share, abs=1e-6)
    assert contacts.gaps[near] == pytest.approx(1e-3, abs=1e-9)
    np.testing.assert_allclose(contacts.normals[near], [0.0, 0.0, 1.0], atol=1e-5)


def test_a_segment_over_an_edge_touches_between_its_nodes() -> None:
    nodes = np.array([[-0.4, 0.0, 0.2], [0.0, 0.1, -0.2], [0.4, 0.2, -0.6]])
    body = Body(Box([0.3, 0.5, 0.3]), position=[-0.5, 0.0, -0.5], motion=Fixed())
    contacts = against(body, nodes, 0.2)
    edge = np.array([-0.2, 0.0, -0.2])
    way = np.array([0.4, 0.1, -0.4])
    across = np.cross(way, [0.0, 1.0, 0.0])
    wanted = abs((nodes[0] - edge) @ across) / np.linalg.norm(across) - RADIUS
    assert np.min(contacts.gaps) == pytest.approx(wanted, abs=1e-7)


def test_a_turning_body_brings_its_surface_along() -> None:
    turn = Prescribed(
        np.array([0.0, 1.0]), np.zeros((2, 3)), np.array([[1.0, 0, 0, 0], [np.cos(0.5), 0, np.sin(0.5), 0]])
    )
    body = Body(Box([1.0, 0.1, 0.1]), motion=turn)
    nodes = np.array([[0.8, -0.5, 0.16], [0.8, 0.5, 0.16]])
    layout, blocks = Layout(np.array([0, 2]), np.array([RADIUS])), np.zeros((1, 2, 3))
    blocks[0, 1, 1] = -1.0  # turns what is at x > 0 upwards
    given = (layout, nodes, np.zeros_like(nodes), [body], BodyStates.at_start([body]))
    assert len(obstacle_contacts(*given, blocks, 0.1, 0.0)) == 1
    assert len(obstacle_contacts(*given, -blocks, 0.1, 0.0)) == 0


def test_fibres_without_a_segment_and_radii_that_are_not_positive_are_refused() -> None:
    with pytest.raises(InputError, match="node_offsets"):
        Layout(np.array([0, 1, 3]), np.full(2, RADIUS))
    with pytest.raises(InputError, match="radii"):
        Layout(np.array([0, 3]), np.zeros(1))
