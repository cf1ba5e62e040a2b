"""Contacts with the ground in statics: penetrations, bristles that follow the nodes, forces and stiffness.

At rest N = k d^p and F = kt s. While a node moves from x0 to x, its bristle goes from s0 to

    s = T min(1, mu N / |kt T|),  T = s0 + w (x - x0) in the plane        (return mapping: F <= mu N)

with w = 1 of a contact that was closed, the closed part d / (d - d0) of the way of one that was open. Where
T is not limited F is the gradient of an energy; where it is, a force whose size follows N.
"""

from collections.abc import Mapping
from copy import copy
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.model.arguments import apply_ground, apply_loads
from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.model.placement import build_node_matrix
from tensegrity_codegen.structure.applied_inputs import find_input_force
from tensegrity_codegen.structure.ground_support import refuse_ground
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray, FloatArray

ON_LIMIT = 1e-9  # part of mu N within which the friction of a state at rest is at its limit
LONG = 1e6  # [m]: deflection of a bristle that is surely beyond its limit


class Contacts:
    """The contacts of a model in statics.

    friction: whether there are tangential forces. limited: whether these are limited to mu N;
    exact: whether the stiffness then has the change of mu N, which makes it unsymmetric. dragged: of
    contacts that a belt drags along under a structure that is held, the direction in the plane, else None.
    limit: (n_contacts,) [N], a constant limit in place of mu N, with which friction has an energy.
    load_factor: part of weights and loads that acts.
    """

    def __init__(self, model: Model, arguments: Mapping[str, Any]) -> None:
        self.model = model
        structure: Structure | None = getattr(model, "structure", None)
        if structure is None:
            raise refuse_ground(
                model.manifest.name,
                "statics of a library that was loaded alone, which does not know its ground",
                'compile_scene("scene.toml", for_="equilibrium")',
            )
        ground = apply_ground(model, arguments)
        assert ground is not None
        self.structure, axes = structure.with_changes(ground=ground), structure.axes
        self.ground = ground
        self.tangents = ground.tangents(axes)
        self.friction = ground.friction > 0
        self.limited = False
        self.exact = False
        self.limit: FloatArray | None = None
        self.slack = 0.0  # part of a limit within which friction counts as at it
        self.dragged: FloatArray | None = None
        self.load_factor = 1.0
        self.external = compute_external_force(self.structure, model, arguments)
        self._nodes = build_node_matrix(model.manifest)
        # Motion of the centres of balls, and of their lowest points: rows of contacts (3 n_contacts, n).
        contacts = (3 * ground.node[:, None] + np.arange(3)).ravel()
        self.motion = self.surface = scipy.sparse.csr_array(self._nodes[contacts])
        self.start: FloatArray | None = None  # (n_contacts, 3), x0 of the lowest points [m]
        self._corners: dict[int, tuple[list[int], FloatArray]] = {}  # of lowest points, with their weights
        self.start_bristle = np.zeros((ground.n_contacts, len(self.tangents)))
        self.start_depth = np.zeros(ground.n_contacts)
        self.load_steps, self.change = 0, 0.0

    @property
    def slide(self) -> FloatArray | None:
        """Direction of a belt in the plane, along `tangents`; None if it rests."""
        speed = float(np.linalg.norm(self.ground.velocity))
        return self.tangents @ self.ground.velocity / speed if speed else None

    def depth(self, position: FloatArray) -> FloatArray:
        """Return the penetrations (n_contacts,) [m] at node positions (n_nodes, 3)."""
        return self.ground.compute_depth(position)

    def normal_force(self, depth: FloatArray) -> FloatArray:
        """Return N at rest, (n_contacts,) [N]."""
        return self.ground.stiffness * np.maximum(depth, 0.0) ** self.ground.exponent

    def under(self, arguments: Mapping[str, Any]) -> "Contacts":
        """Return the same contacts under other loads."""
        result = copy(self)
        result.external = compute_external_force(self.structure, self.model, arguments)
        return result

    def begin(self, position: FloatArray, bristle: FloatArray | None = None) -> None:
        """Take node positions (n_nodes, 3) and bristles (n_internal,) for x0 and s0."""
        self._find_surface(position)
        self.start = self._place_surface(position)
        self.start_depth = self.depth(position)
        shape, size = self.start_bristle.shape, self.start_bristle.size
        values = np.zeros(size) if bristle is None else np.ravel(bristle)[:size]
        self.start_bristle = values.reshape(shape)

    def _find_surface(self, position: FloatArray) -> None:
        """Let the lowest points of balls on bodies, as they are now, move with their bodies."""
        self._corners, rows = {}, self.motion.tolil()
        body_of = {node: body for body in self.model.manifest.body_places for node in body.point}
        for c, (node, radius) in enumerate(zip(self.ground.node.tolist(), self.ground.radius, strict=True)):
            if (body := body_of.get(node)) is None or not radius:
                continue
            weights = body.touch(node, -radius * self.ground.normal, position)
            self._corners[c] = list(body.corner), weights
            at = (3 * np.array(body.corner)[:, None] + np.arange(3)).ravel()
            spread = np.kron(weights, np.eye(3))
            rows[3 * c : 3 * c + 3] = spread @ self._nodes[at]
        self.surface = scipy.sparse.csr_array(rows) if self._corners else self.motion

    def _place_surface(self, position: FloatArray) -> FloatArray:
        """Return where the lowest points of the start are, (n_contacts, 3) [m]."""
        place = np.array(position[self.ground.node])
        for c, (corner, weights) in self._corners.items():
            place[c] = weights @ position[corner]
        return place

    def rest(self, position: FloatArray, bristle: FloatArray | None) -> None:
        """Take a state at rest, bristles zero if None; feet within rounding of their limit slip."""
        self.begin(position, bristle)
        self.limited, self.slack = True, ON_LIMIT

    def find_held(self, position: FloatArray) -> FloatArray:
        """Return rows over the coordinates that closed contacts hold, along n and where they do not slip."""
        depth, (bristle, slips), rows = self.depth(position), self.bristles(position), []
        for c in np.flatnonzero(depth > 0).tolist():
            size = np.linalg.norm(bristle[c])
            along = bristle[c] / size if slips[c] and size else 0.0 * bristle[c]
            across = (np.eye(len(along)) - np.outer(along, along)) @ self.tangents
            at = slice(3 * c, 3 * c + 3)
            rows.append(np.asarray(self.ground.normal[None] @ self.motion[at]))
            rows.append(np.asarray((across if self.friction else across[:0]) @ self.surface[at]))
        return np.vstack([np.zeros((0, self.motion.shape[1])), *rows])

    def bristles(self, position: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the bristles s (n_contacts, n_tangents) [m], and which contacts slip (n_contacts,)."""
        trial = self._find_trial(position)
        if not self.friction or not self.limited:
            return trial, np.zeros(len(trial), dtype=bool)
        limit = self.find_limit(position) / self.ground.stick_stiffness
        size = np.linalg.norm(trial, axis=1)
        slips = size > limit * (1.0 - self.slack)
        return trial * np.where(slips, limit / np.where(slips, size, 1.0), 1.0)[:, None], slips

    def find_limit(self, position: FloatArray) -> FloatArray:
        """Return the largest friction of each contact, (n_contacts,) [N]."""
        if self.limit is not None:
            return self.limit
        return self.ground.friction * self.normal_force(self.depth(position))

    def state(self, position: FloatArray) -> dict[str, FloatArray]:
        """Return the argument `internal` of these positions, none if the ground has no friction."""
        if not self.structure.internal_name:
            return {}
        internal = np.zeros(len(self.structure.internal_name))
        if self.friction and self.start is not None:
            internal[: self.start_bristle.size] = self.bristles(position)[0].ravel()
        return {"internal": internal}

    def forces(self, position: FloatArray) -> FloatArray:
        """Return the forces of the ground on the nodes of the contacts, (n_contacts, 3) [N]."""
        normal = self.normal_force(self.depth(position))
        force: FloatArray = normal[:, None] * self.ground.normal
        if self.friction and self.start is not None:
            force = force - self.ground.stick_stiffness * self.bristles(position)[0] @ self.tangents
        return force

    def friction_stiffness(self, position: FloatArray, *, exact: bool) -> Any:
        """Return dF/dq, sparse (n_coordinates, n_coordinates) [N/m].

        exact: the derivative of kt s by positions, unsymmetric where contacts slip, since mu N changes.
        Otherwise of a small displacement from here: a contact that slips resists only across its slip.
        """
        size = self.motion.shape[1]
        if not self.friction or self.start is None:
            return scipy.sparse.csc_array((size, size))
        kt, ground = self.ground.stick_stiffness, self.ground
        trial, slope = self._find_trial(position), self._find_trial_slope(position)
        bristle, slips = self.bristles(position)
        depth = self.depth(position)
        along_plane, by_depth = [], []  # of the lowest point by its own motion, and by that of the centre
        # Of each contact kt dT/dx, across its slip only where mu N limits the friction.
        for c in range(ground.n_contacts):
            length = float(np.linalg.norm(trial[c]))
            along = trial[c] / length if slips[c] else 0.0 * trial[c]
            across = np.eye(len(along)) - np.outer(along, along)
            if not exact and self.limit is None:
                holds = depth[c] > 0 if self.limited else self.start_depth[c] >= 0
                block, normal = kt * holds * self.tangents.T @ across @ self.tangents, np.zeros(3)
            elif not slips[c]:
                block, normal = kt * self.tangents.T @ slope[0][c], kt * self.tangents.T @ slope[1][c]
            else:
                fraction = float(np.linalg.norm(bristle[c])) / length
                gain = ground.friction * ground.exponent * ground.stiffness
                gain *= 0.0 if self.limit is not None else 1.0
                gain *= max(depth[c], 0.0) ** (ground.exponent - 1.0) * (depth[c] > 0)
                across = kt * fraction * self.tangents.T @ across
                block = across @ slope[0][c]
                normal = across @ slope[1][c] - gain * self.tangents.T @ along
            along_plane.append(block)
            by_depth.append(np.outer(normal, ground.normal))
        plane, depths = (scipy.sparse.block_diag(blocks) for blocks in (along_plane, by_depth))
        return scipy.sparse.csc_array(self.surface.T @ (plane @ self.surface + depths @ self.motion))

    def complete(self, quantity: str, value: Any, coordinate: FloatArray, position: FloatArray) -> Any:
        """Return a quantity of the model with friction's stiffness and the load factor, which it lacks."""
        missing = 1.0 - self.load_factor
        if quantity == "tangent_stiffness":
            return value + self.friction_stiffness(position, exact=self.exact)
        if missing and quantity == "node_residual":
            return value - missing * (self._nodes.T @ self.external.ravel())
        if quantity == "potential_energy":
            slipped = 0.0
            if (
                self.limit is not None
            ):  # friction F with constant limits: sum F (|T| - |s|) besides kt s^2 / 2
                trial, (bristle, _) = self._find_trial(position), self.bristles(position)
                size, stretched = np.linalg.norm(trial, axis=1), np.linalg.norm(bristle, axis=1)
                slipped = float(np.sum(self.ground.stick_stiffness * stretched * (size - stretched)))
            return value + missing * float(np.sum(self.external * position)) + slipped
        return value

    def _find_trial(self, position: FloatArray) -> FloatArray:
        """Return T, the bristles without a limit, (n_contacts, n_tangents) [m]."""
        moved, depth, closed, _, weight = self._weigh(position)
        if self.dragged is not None:
            return np.where(depth > 0, -LONG, 0.0)[:, None] * self.dragged
        return np.where(closed[:, None], self.start_bristle, 0.0) + weight[:, None] * moved

    def _find_trial_slope(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return dT/dx of lowest points (n_contacts, n_tangents, 3), and that of centres along the normal."""
        moved, depth, _, closes, weight = self._weigh(position)
        if self.dragged is not None:
            return np.zeros((*moved.shape, 3)), np.zeros(moved.shape)
        span = np.where(closes, depth - self.start_depth, 1.0)
        change = np.where(closes, -self.start_depth / span**2, 0.0)
        return weight[:, None, None] * self.tangents, -change[:, None] * moved

    def _weigh(self, position: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray, FloatArray]:
        """Return way in the plane and depth [m], closed at x0, closes, and the part of bristles' way."""
        assert self.start is not None
        moved = (self._place_surface(position) - self.start) @ self.tangents.T
        depth, before = self.depth(position), self.start_depth
        closed = before >= 0.0
        closes = ~closed & (depth > 0) & (self.limited and self.limit is None)
        fraction = np.where(closed, 1.0, np.where(closes, depth / np.where(closes, depth - before, 1.0), 0.0))
        return moved, depth, closed, closes, fraction


def compute_external_force(structure: Structure, model: Model, arguments: Mapping[str, Any]) -> FloatArray:
    """Return weights and loads on all nodes under run-time arguments, (n_nodes, 3) [N]."""
    axes, manifest = list(structure.axes), model.manifest
    gravity, mass = np.array(structure.gravity), np.array(structure.lumped_mass)
    if arguments.get("gravity") is not None:
        gravity[axes] = np.ravel(arguments["gravity"])
    if arguments.get("node_mass") is not None:
        rows = [manifest.node_name.index(name) for name in manifest.argument("node_mass").over]
        mass[rows] += np.ravel(arguments["node_mass"]) - structure.node_mass[rows]
    load = apply_loads(model, arguments)
    force = mass[:, None] * gravity + (structure.node_load if load is None else load[0])
    if arguments.get("input") is not None:
        values = dict(zip(manifest.input_name, np.ravel(arguments["input"]).tolist(), strict=True))
        force = force + find_input_force(structure, values)
    outside = [axis for axis in range(3) if axis not in axes]
    force[:, outside] = 0.0
    return np.asarray(force)
