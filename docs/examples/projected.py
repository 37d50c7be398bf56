"""An outer method of your own: projected gradients, s ← P(s − ρ r), and their answer beside that of Newton's method.

    python docs/examples/projected.py

docs/use/methods.md says what such a class promises. Things to try: the step ρ from more steps of the power iteration,
a step that is conjugate to the one before, other scenes, mpirun -n 2.
"""

import numpy as np

import ddmpi
from ddmpi.methods.outer import Outer, Step


class Projected(Outer):
    """s ← P(s − ρ r) with the gaps r = C s − d and the projection P onto the bounds that follow from s − ρ r."""

    def __init__(self, assembly, method, report):
        self.joint, self.space, self.report = assembly.joint, assembly.space, report
        self.most, self.history = method.max_iterations, []
        self.s = np.zeros(self.joint.size)
        x = np.ones(self.joint.size)
        for _ in range(10):  # the power iteration: ρ is 1 over the largest eigenvalue of C, about
            x = self.joint.product(x / self.space.norm(x), "projected")
        self.rho = 1.0 / self.space.norm(x)

    @property
    def forces(self):
        return self.s

    @property
    def bound(self):
        return self.space.laws.bound_at(self.s)

    def body_forces(self):
        return self.joint.exchange.spread(self.s)

    def run(self, tolerance):
        while len(self.history) < self.most:
            r = self.joint.product(self.s, "projected") - self.joint.d
            before, self.s = self.s, self.space.laws.project(self.s - self.rho * r)
            update = self.space.norm(self.s - before) / (self.space.norm(self.s) or 1.0)
            step = Step(len(self.history) + 1, update, update, 0.0, self.joint.multiplications())
            self.history.append(step)
            self.report(step)
            if update <= tolerance:
                return "converged"
        return "max_iterations"

    def refresh(self, u):
        pass

    def state(self):
        return {"s": self.s, "history": tuple(self.history)}

    def restore(self, state):
        self.s, self.history = state["s"], [Step(*row) for row in state["history"]]


def main() -> None:
    coarse = {f"body.{name}.mesh.divisions": [9, 3] for name in ("upper", "lower")}
    accurate = coarse | {"method.max_iterations": 20_000, "method.tolerance": 1e-8}
    forces = []
    for outer in ("newton", Projected):
        answer = ddmpi.solve(
            "configs/pinched_blocks.toml", overrides=accurate, only="contacts", outer=outer
        )
        assert answer.certified, answer.reason
        forces.append(answer.contacts["upper-lower"].forces)
        name, steps = answer.summary["outer"], answer.summary["outer_iterations"]
        print(f"{name}: {steps} iterations, {answer.summary['n_A']} products")
    assert np.allclose(*forces, atol=1e-5 * np.abs(forces[0]).max())


if __name__ == "__main__":
    main()
