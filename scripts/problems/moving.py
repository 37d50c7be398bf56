"""Verification problems of bodies that move far; `scripts/study far` has more of them."""

from __future__ import annotations

from pathlib import Path

import far
import far_free
import numpy as np
from mpi4py import MPI
from scenes import to_toml

import ddmpi
from problems import Curve, Found, Order, Value, number, problem

EXACT = 1e-9


@problem("sliding-block", "A block slid along a longer one", (1, 2, 4), "sixteenths of the block on its contact, × n",
         shows="Bodies that move far: friction T = μ N all along the way, whatever the number of load steps.",
         scene="A block of 1 m × 0.5 m, E = 1 kPa, ν = 0.3, is pressed 4 mm into a block of 5 m × 1 m and slid by "
               "1.25 m in 8 load steps, and in 1; μ = 0.3. Nodes do not match: 16 : 13.4 on a metre.",
         source="Coulomb's law. T over N in the step in which it differs most; how much the forces at the end of 8 and "
                "of 1 step differ, over N; on the right the ratio of the stresses at the closed nodes.")
def sliding_block(n: int, order: Order, folder: Path) -> Found:
    answer, once = (ddmpi.solve(to_toml(far.block(number(order), steps, fine=n)), MPI.COMM_SELF) for steps in (8, 1))
    if not answer.certified or not once.certified:
        raise RuntimeError(answer.reason + once.reason)
    found, end = far.forces(answer.summary, 1.1), far.forces(once.summary, 1.1)[-1, 1:]
    ratio = np.abs(found[:, 1] / found[:, 2])
    worst = float(ratio[np.abs(ratio - far.FRICTION).argmax()])
    state = answer.contacts["slider-base"]
    closed = np.flatnonzero(state.status != "open")
    x = state.interface.xy[closed, 0]
    order_of = np.argsort(x)
    stresses = np.abs(state.shear.reshape(len(state.pressure), -1)[closed, 0] / state.pressure[closed])[order_of]
    return Found({"T/N": Value(worst, far.FRICTION, EXACT),
                  "forces at the end, 8 steps and 1": Value(
                      float(np.abs(found[-1, 1:] - end).max() / found[-1, 2]), 0.0, EXACT)},
                 answer, Curve(x[order_of], stresses, x[order_of], np.full(len(x), far.FRICTION), "x (m)",
                               "tangential over normal stress"))


@problem("turned-pair", "Two bodies turned together", (1, 2, 3), "two-hundred-and-fortieths of the ring, × n",
         shows="Bodies that move far: forces turn with the bodies, and friction dissipates nothing.",
         scene="A ring of 0.5 m and 1 m is pressed 20 mm into a block and rubbed by 20 mm; then both are turned by 90° "
               "about a point beside them, and shifted, in 9 load steps.",
         source="Objectivity. The change of the force over its size, and the dissipation of the turn over that of "
                "rubbing.")
def turned_pair(n: int, order: Order, folder: Path) -> Found:
    answer = ddmpi.solve(to_toml(far.turned(number(order), fine=n)), MPI.COMM_SELF)
    if not answer.certified:
        raise RuntimeError(answer.reason)
    change, lost = far.turn_errors(answer.summary)
    state = answer.contacts["ring-base"]
    y = state.interface.xy[:, 1]
    order_of = np.argsort(y)
    p = state.pressure[order_of]
    return Found({"change of the force": Value(change, 0.0, EXACT), "dissipation of the turn": Value(lost, 0.0, EXACT)},
                 answer, Curve(y[order_of], p, y[order_of], p, "y (m)", "pressure (Pa)", "after the turn"))


@problem("spur-gears", "Teeth of spur gears in mesh", (1, 2), "twentieths of the pitch as steps, × n", orders=(2,),
         shows="Bodies that move far: stiffness and loss of teeth that mesh.",
         scene="`configs/drawn/spur_gears.toml`: 20 : 20 teeth of steel, module 3 mm, turned by a pitch in 20 and 40 "
               "load steps with a deflection of 21.4 µm along the line of action; μ = 0.1.",
         source="The largest stiffness of a pair of teeth by ISO 6336-1, without its factor for measured gears; the "
                "loss of power by ISO/TR 14179. On the right the loss of a tooth that bears alone: friction at a "
                "distance y from the pitch point costs 2 μ y / r_b of the power.")
def spur_gears(n: int, order: Order, folder: Path) -> Found:
    answer = ddmpi.solve(to_toml(far.gears(steps=20 * n)), MPI.COMM_SELF)
    if not answer.certified:
        raise RuntimeError(answer.reason)
    angle, stiff, loss = far.meshing(answer.summary)
    exact, factor = far.gear_theory()
    single = far.alone(angle)
    return Found({"stiffness of a pair": Value(float(stiff[single].max()), exact, 0.06),
                  "loss of power": Value(float(loss.mean()), 0.1 * factor, 0.1)}, answer,
                 Curve(angle, loss, angle[single], 0.2 * np.abs(np.radians(angle[single] + 4.4045)), "angle (degrees)",
                       "loss of power"))


@problem("rolling-disc", "A loose disc that rolls in a bore", (1, 2, 4), "eightieths of the disc, × n",
         shows="Bodies that move far: a body without supports goes where forces take it.",
         scene="A disc of 1 m lies in a bore of 1.5 m by its weight W, without supports; the bore is turned by 30° in "
               "10 load steps; μ = 0.3.",
         source="Statics: N = W, T = 0. Without creep the disc turns 1.5 times as far as the bore.")
def rolling_disc(n: int, order: Order, folder: Path) -> Found:
    answer = far.solved(far_free.rolling(number(order), 30.0, 10, n))
    turned, normal, tangential, _ = far_free.rolled(answer)
    state = answer.contacts["disc-bore"]
    x, y = state.interface.xy.T
    near = (np.abs(x) < 0.4) & (y < -1.0)
    order_of = np.flatnonzero(near)[np.argsort(x[near])]
    p = state.pressure[order_of]
    return Found({"N/W": Value(1.0 + normal, 1.0, EXACT), "T/W": Value(tangential, 0.0, EXACT),
                  "turn over that of the bore": Value(turned / 30.0, 1.5, 0.03)}, answer,
                 Curve(x[order_of], p, x[order_of], p, "x (m)", "pressure (Pa)", "after the turn"))


@problem("carter", "A roller that drives itself on", (4, 8), "nodes on the half-width", orders=(2,),
         shows="Bodies that move far: creep of a rolling contact, with an axle that is free to move.",
         scene="A roller of 1 m on a plate of the same material, ν = 0.3, pressed by P with a half-width a = 0.035 m, "
               "is turned against a force Q = 0.5 μ P at its axle by 6 a; μ = 0.3.",
         source="Carter 1926: creep μ a/R (1 − √(1 − Q/μP)), here less that without Q; Hertz's p₀ = 2P/πa, on the "
                "right with his pressure.")
def carter(n: int, order: Order, folder: Path) -> Found:
    (still, *_), (creep, pressure, exact, answer) = (far_free.carter(share, folder, n) for share in (0.0, 0.5))
    state, a = answer.contacts["roller-plate"], 0.035
    x = state.interface.xy[:, 0]
    x = x - (x * state.normal_force).sum() / state.normal_force.sum()
    order_of = np.argsort(x)[np.abs(np.sort(x)) < 1.5 * a]
    p0 = state.pressure.max() / pressure
    z = np.linspace(-1.5 * a, 1.5 * a, 200)
    hertz = p0 * np.sqrt(np.maximum(0.0, 1.0 - (z / a) ** 2))
    creeps, pressures = (0.03, 0.005) if n > 4 else (0.1, 0.02)
    return Found({"creep": Value(creep - still, exact, creeps), "p₀": Value(pressure, 1.0, pressures)}, answer,
                 Curve(x[order_of], state.pressure[order_of], z, hertz, "x (m)", "pressure (Pa)", "Hertz"))
