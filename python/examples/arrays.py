"""Accelerations of many states, and their derivatives."""

import dynid
import numpy


def main() -> None:
    kernel = dynid.devices["freedom6s"].kernel(free=[3, 4])
    generator = numpy.random.default_rng(1)
    q, dq, tau = (generator.uniform(-0.5, 0.5, (100_000, 2)) for _ in range(3))
    ddq = kernel.forward_dynamics(q, dq, tau)
    off = abs(kernel.inverse_dynamics(q, dq, ddq) - tau).max()
    print(f"{len(ddq)} states; torques of their accelerations are off by less than 1e-9 N*m: {off < 1e-9}")
    _, by_q, _, _ = kernel.forward_dynamics_derivatives(q, dq, tau)
    print(f"derivatives by position: {by_q.shape}")


if __name__ == "__main__":
    main()
