"""Chains in several coordinates stepped side by side, as one `Model` of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.chains import ChainState, ReferenceMotion
from barchan.bodies.moreau import AssemblyRecord
from barchan.linalg.frames import contact_frames
from barchan.scenes.kinds.chain.building import build_models
from barchan.scenes.kinds.chain.parameters import ChainParameters
from barchan.scenes.model import Arrays

Vector = NDArray[np.float64]

_WORST = (
    "residual",
    "law_residual",
    "balance_residual",
    "bilateral_residual",
    "deepest",
    "joint_error",
    "max_speed",
)
_SUMS = ("sweeps", "candidates", "detection_seconds", "solve_seconds")


@dataclass(frozen=True, eq=False)
class ChainsState:
    """The states of the models at one time, by name."""

    chains: Mapping[str, ChainState]

    @property
    def time(self) -> float:
        """[s]."""
        return next(iter(self.chains.values())).time


class ChainsModel:
    """The model of a scene of kind "chain".

    Raises InputError for a chain or obstacles that cannot be, and joints that start in an obstacle.
    """

    def __init__(self, parameters: ChainParameters) -> None:
        self._parameters = parameters
        self.models = build_models(parameters)
        self._first = next(iter(self.models))

    def initial(self) -> ChainsState:
        """The chains where they start."""
        return ChainsState({name: model.started() for name, model in self.models.items()})

    def arrays(self, state: ChainsState) -> Arrays:
        """The complete state, for a checkpoint."""
        return {
            f"{name}_{field}": values
            for name, chain in state.chains.items()
            for field, values in chain.arrays().items()
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> ChainsState:
        """The state of a checkpoint."""
        return ChainsState({
            name: model.restored({
                field.removeprefix(f"{name}_"): values
                for field, values in arrays.items()
                if field.startswith(f"{name}_")
            })
            for name, model in self.models.items()
        })  # fmt: skip

    def longest_step(self, state: ChainsState) -> float:
        """The step of the scene."""
        return self._parameters.time.step

    def advance(self, state: ChainsState, dt: float) -> tuple[ChainsState, AssemblyRecord]:
        """One step of every model; the record has energies and contacts of the first, iterations of all, else the worst."""
        moved, records = {}, []
        for name, model in self.models.items():
            moved[name], record = model.advance(state.chains[name], dt)
            records.append(record)
        worst = {field: max(getattr(record, field) for record in records) for field in _WORST}
        sums = {field: sum(getattr(record, field) for record in records) for field in _SUMS}
        converged = all(record.converged for record in records)
        return ChainsState(moved), replace(records[0], **worst, **sums, converged=converged)

    def ended(self, state: ChainsState) -> bool:
        """Never before the end."""
        return False

    def frame(self, state: ChainsState) -> dict[str, Arrays]:
        """Joints of all models, model after model, and the contacts that carry force, joints numbered as they stand there."""
        joints, speeds, contacts = [], [], []
        for number, (name, model) in enumerate(self.models.items()):
            chain = state.chains[name]
            joints.append(model.joints(chain))
            speeds.append(model.joint_velocities(chain))
            loaded = chain.forces[:, 0] > 0.0
            rows = model.obstacles.pairs(chain.contact_keys[loaded])[0] + number * len(joints[0])
            forces = np.einsum("kij,ki->kj", contact_frames(chain.normals[loaded]), chain.forces[loaded])
            contacts.append((chain.points[loaded], chain.normals[loaded], forces, rows))
        points, normals, forces, rows = (np.concatenate(parts) for parts in zip(*contacts, strict=True))
        places = np.concatenate(joints)
        return {
            "particles": {
                "positions": places, "velocities": np.concatenate(speeds), "volumes": np.zeros(len(places)),
                "models": np.repeat(np.arange(len(joints)), len(joints[0])),
            },
            "contacts": {"positions": points, "normals": normals, "forces": forces, "joints": rows},
        }  # fmt: skip

    def observables(self, state: ChainsState, record: AssemblyRecord | None) -> dict[str, float]:
        """Tips (m), energies (J), distances of the models from each other and from the reference motion (m)."""
        first, model = state.chains[self._first], self.models[self._first]
        joints = {name: self.models[name].joints(chain) for name, chain in state.chains.items()}
        apart = [_distance(joints[a], joints[b]) for a, b in combinations(joints, 2)]
        found = {
            "time": state.time,
            "kinetic_energy": model.kinetic_energy(first),
            "potential_energy": model.potential_energy(first),
            "contacts": 0.0 if record is None else float(record.contacts),
            "difference": max(apart, default=0.0),
        }
        for name, places in joints.items():
            chain, model = state.chains[name], self.models[name]
            found[f"tip_x_{name}"], found[f"tip_z_{name}"] = (float(value) for value in places[-1])
            found[f"energy_{name}"] = model.kinetic_energy(chain) + model.potential_energy(chain)
        if not model.obstacles.bodies:
            exact = self._reference.joints([state.time])[0]
            found["tip_x_exact"], found["tip_z_exact"] = (float(value) for value in exact[-1])
            found |= {f"error_{name}": _distance(places, exact) for name, places in joints.items()}
        found["certificate"] = 0.0 if record is None else record.residual
        return found

    @cached_property
    def _reference(self) -> ReferenceMotion:
        """The motion without obstacles to high order, to the last frame."""
        end = self._parameters.frame_count / self._parameters.frame_rate
        return ReferenceMotion(self.models[self._first].chain, end)


def _distance(places: Vector, others: Vector) -> float:
    """Largest distance [m] between joints of the same number."""
    return float(np.max(np.linalg.norm(places - others, axis=1)))
