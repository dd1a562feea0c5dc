"""What a step leaves on the grid for the next one and for whoever looks: velocities, stresses, fractions, tractions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.flows.mpm.contacts import Contacts
from barchan.flows.mpm.options import Options
from barchan.flows.mpm.stresses import StressRows
from barchan.flows.mpm.transfer import GridMatter

Vector = NDArray[np.float64]


def kept_on_grid(
    options: Options, matter: GridMatter, rows: StressRows, contacts: Contacts, stresses: Vector, friction: Vector,
    tractions: Vector, velocities: Vector,
) -> dict[str, Any]:  # fmt: skip
    """Fields of `State` at the active nodes.

    stresses, friction : (q, s) [Pa] and (q,) of the rows.  tractions : (k, d) [Pa] of the contacts.
    velocities : (n, d) at the active nodes.
    """
    nodes = matter.active.nodes
    own: dict[str, NDArray[Any]] = {"stress_ids": nodes[:0], "stresses": stresses[:0]}
    if options.stress == "Q1":
        at_nodes = np.zeros((len(nodes), stresses.shape[1] + 1))
        at_nodes[np.searchsorted(nodes, rows.ids)] = np.column_stack([stresses, friction])
    else:
        at_nodes = rows.node_means(matter, np.column_stack([stresses, friction]))
        if options.stress != "particles" and options.warm_start == "grid":
            own = {"stress_ids": rows.ids, "stresses": stresses}
    return {
        "node_ids": nodes,
        "node_velocities": velocities,
        "node_stresses": np.ascontiguousarray(at_nodes[:, :-1]),
        "node_friction": at_nodes[:, -1].copy(),
        "node_volume_fractions": matter.volume_fractions,
        "contact_keys": contacts.keys,
        "contact_tractions": tractions.copy(),
        **own,
    }
