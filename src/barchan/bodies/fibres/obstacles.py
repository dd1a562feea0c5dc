"""Where fibres may touch rigid bodies within a step: signed distances at the nodes and, between them, at the nearest points.

A node within reach has a contact; a segment has one more where its middle part comes nearer than both of its ends.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.fibres.contact import KEY_BITS, NO_FIBRE, FibreContacts, Layout
from barchan.bodies.rigid import Body, BodyState, BodyStates, body_distance, body_normals, contact_columns

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]

_SAMPLES = 9  # along a segment, ends included
_SEARCHES = 32  # steps of the golden section: to 1e-7 of a segment
_FLAT = 1e-9  # differences of distance over length that are rounding
_SAME = 0.5  # of a radius: places of contact nearer than this are one
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
_NODE, _WITHIN, _TIP = range(3)


def obstacle_contacts(
    layout: Layout, nodes: Vector, velocities: Vector, bodies: Sequence[Body], states: BodyStates, blocks: Vector, dt: float,
    slack: float, bare: float = 0.0,
) -> FibreContacts:  # fmt: skip
    """Contacts of fibres with bodies that move at `blocks` (b, 2, 3), with gaps up to `slack` [m] and what they close in `dt`.

    bare : length of fibre [m] at the roots that touches nothing.
    """
    arc, lengths = layout.arc(nodes), layout.lengths(nodes)
    found = [empty_contacts()]
    for number, body in enumerate(bodies):
        state = states.row(number)
        speed = _fastest(velocities, blocks[number], nodes, state.position)
        reach = slack + dt * speed
        segment, share, name = _near_places(layout, nodes, body, state, reach)
        kept = arc[segment] + share * lengths[segment] >= bare
        segment, share, name = segment[kept], share[kept], name[kept]
        found.append(
            _contacts(layout, nodes, velocities, body, state, blocks[number], number, segment, share, name)
        )
        closing = dt * np.maximum(
            -_normal_speeds(found[-1], layout, velocities, body, state, blocks[number]), 0.0
        )
        found[-1] = found[-1].take(found[-1].gaps <= slack + closing)
    return FibreContacts.joined(found)


def empty_contacts() -> FibreContacts:
    """No contact."""
    none, nothing = np.zeros((0, 3)), np.zeros((0, 2), dtype=np.int64)
    return FibreContacts(
        nothing, nothing, np.zeros((0, 2)), nothing[:, 0], none, none, none[:, 0], nothing[:, 0]
    )


def point_velocities(body: Body, state: BodyState, block: Vector, points: Vector) -> Vector:
    """(k, 3) velocities [m/s] of the matter of a body at world points (k, 3), its own being `block` (2, 3)."""
    columns = contact_columns(body, state, points)
    return np.asarray(np.einsum("kbij,bj->ki", columns, block))


def _fastest(velocities: Vector, block: Vector, nodes: Vector, middle: Vector) -> float:
    """A bound on the speed [m/s] at which any node comes nearer to a body."""
    arms = np.max(np.linalg.norm(nodes - middle, axis=1))
    turning = float(np.linalg.norm(block[1])) * float(arms)
    return float(np.max(np.linalg.norm(velocities - block[0], axis=1))) + turning


def _near_places(
    layout: Layout, nodes: Vector, body: Body, state: BodyState, reach: float
) -> tuple[Whole, Vector, Whole]:
    """Segments, shares and names of the places of fibres within `reach` [m] of a body."""
    radius = layout.radii[layout.fibre]
    at_node = body_distance(body, state, nodes)
    first = layout.first
    near = at_node[first] - radius <= reach
    tip = (layout.end & 2 > 0) & (at_node[first + 1] - radius <= reach)
    begins, tips = np.flatnonzero(near), np.flatnonzero(tip)
    # between its ends a segment is nearer by less than half its length
    lowest = 0.5 * (at_node[first] + at_node[first + 1] - layout.lengths(nodes))
    candidates = np.flatnonzero(lowest - radius <= reach)
    within, share = _nearer_within(layout, nodes, body, state, candidates, at_node)
    depth = body_distance(body, state, _along(layout, nodes, within, share)) - radius[within]
    within, share = within[depth <= reach], share[depth <= reach]
    return (
        np.concatenate([begins, within, tips]),
        np.concatenate([np.zeros(len(begins)), share, np.ones(len(tips))]),
        np.repeat([_NODE, _WITHIN, _TIP], [len(begins), len(within), len(tips)]),
    )


def _along(layout: Layout, nodes: Vector, segment: Whole, share: Vector) -> Vector:
    """(k, 3) points of the centre lines."""
    start = nodes[layout.first[segment]]
    return np.asarray(start + share[:, None] * (nodes[layout.first[segment] + 1] - start))


def _nearer_within(
    layout: Layout, nodes: Vector, body: Body, state: BodyState, segment: Whole, at_node: Vector
) -> tuple[Whole, Vector]:
    """Segments that come nearer to a body between their ends than at both, and the shares where they do."""
    if len(segment) == 0:
        return segment, np.zeros(0)
    samples = np.linspace(0.0, 1.0, _SAMPLES)
    places = _along(layout, nodes, np.repeat(segment, _SAMPLES), np.tile(samples, len(segment)))
    values = body_distance(body, state, places).reshape(len(segment), _SAMPLES)
    # what is flat to rounding is held by its ends
    length = layout.lengths(nodes)[segment]
    curved = np.ptp(values, axis=1) > _FLAT * length
    chosen, length = segment[curved], length[curved]
    lowest = np.argmin(values[curved], axis=1)
    share = _golden(
        lambda x: body_distance(body, state, _along(layout, nodes, chosen, x)),
        samples[np.maximum(lowest - 1, 0)], samples[np.minimum(lowest + 1, _SAMPLES - 1)],
    )  # fmt: skip
    nearest = body_distance(body, state, _along(layout, nodes, chosen, share))
    ends = np.minimum(at_node[layout.first[chosen]], at_node[layout.first[chosen] + 1])
    inside = np.minimum(share, 1.0 - share) * length > _SAME * layout.radii[layout.fibre[chosen]]
    lower = inside & (nearest < ends - _FLAT * length)
    return chosen[lower], share[lower]


def _golden(value: Callable[[Vector], Vector], low: Vector, high: Vector) -> Vector:
    """(k,) places of the least values between `low` and `high`, each by its own golden section."""
    if len(low) == 0:
        return low
    a, b = low.copy(), high.copy()
    x, y = b - _GOLDEN * (b - a), a + _GOLDEN * (b - a)
    at_x, at_y = value(x), value(y)
    for _ in range(_SEARCHES):
        left = at_x <= at_y
        a, b = np.where(left, a, x), np.where(left, y, b)
        new = np.where(left, b - _GOLDEN * (b - a), a + _GOLDEN * (b - a))
        at_new = value(new)
        x, y, at_x, at_y = (
            np.where(left, new, y), np.where(left, x, new), np.where(left, at_new, at_y), np.where(left, at_x, at_new),
        )  # fmt: skip
    return np.asarray(0.5 * (a + b))


def _contacts(
    layout: Layout, nodes: Vector, velocities: Vector, body: Body, state: BodyState, block: Vector, number: int, segment: Whole,
    share: Vector, name: Whole,
) -> FibreContacts:  # fmt: skip
    """The contacts of some places of fibres with a body."""
    places = _along(layout, nodes, segment, share)
    radius = layout.radii[layout.fibre[segment]]
    gaps = body_distance(body, state, places) - radius
    normals = body_normals(body, state, places)
    fibre = layout.fibre[segment]
    nowhere = np.full(len(segment), NO_FIBRE)
    points = places - (radius + 0.5 * gaps)[:, None] * normals
    keys = (segment << KEY_BITS) | (len(layout.fibre) + 3 * number + name)
    return FibreContacts(
        np.stack([fibre, nowhere], axis=1), np.stack([segment - layout.starts[fibre], nowhere], axis=1),
        np.stack([share, np.zeros(len(share))], axis=1), np.full(len(segment), number), points, normals, gaps, keys,
    )  # fmt: skip


def _normal_speeds(
    contacts: FibreContacts, layout: Layout, velocities: Vector, body: Body, state: BodyState, block: Vector
) -> Vector:
    """(k,) at which the two sides part along the normal [m/s]."""
    segment = layout.starts[contacts.fibres[:, 0]] + contacts.segments[:, 0]
    own = _along(layout, velocities, segment, contacts.shares[:, 0])
    other = point_velocities(body, state, block, contacts.points)
    return np.asarray(np.einsum("ki,ki->k", own - other, contacts.normals))
