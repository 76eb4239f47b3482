"""Equations on whole arrays, and residuals for other optimisers."""

from __future__ import annotations

from pathlib import Path

import dynid
import numpy
import pytest
from scipy.optimize import least_squares

GENERATOR = numpy.random.default_rng(5)


def states(*shape: int) -> list[numpy.ndarray]:
    return [GENERATOR.uniform(-1.0, 1.0, shape) for _ in range(3)]


@pytest.mark.parametrize("free", [None, [3, 4]])
def test_torque_and_acceleration_undo_each_other(robot: dynid.Device, free: list[int] | None) -> None:
    kernel = robot.kernel(free)
    n = len(kernel.free)
    q, dq, tau = states(3001, n)
    ddq = kernel.forward_dynamics(q, dq, tau)
    numpy.testing.assert_allclose(kernel.inverse_dynamics(q, dq, ddq), tau, atol=1e-9)
    by_hand = numpy.einsum("kij,kj->ki", kernel.mass_matrix(q), ddq) + kernel.bias(q, dq)
    numpy.testing.assert_allclose(by_hand, tau, atol=1e-9)
    numpy.testing.assert_allclose(kernel.bias(q, 0 * dq), kernel.gravity(q), atol=1e-12)


def test_any_shape_and_any_layout(robot: dynid.Device) -> None:
    kernel = robot.kernel([3, 4])
    assert kernel.free == [3, 4]
    q, dq, tau = states(5, 7, 2)
    ddq = kernel.forward_dynamics(q, dq, tau)
    assert ddq.shape == (5, 7, 2) and kernel.mass_matrix(q).shape == (5, 7, 2, 2)
    numpy.testing.assert_array_equal(kernel.forward_dynamics(q[1, 2], dq[1, 2], tau[1, 2]), ddq[1, 2])
    slanted = [numpy.asfortranarray(own) for own in (q, dq, tau)]
    numpy.testing.assert_array_equal(kernel.forward_dynamics(*slanted), ddq)
    numpy.testing.assert_array_equal(kernel.forward_dynamics(q.tolist(), dq.tolist(), tau.tolist()), ddq)
    assert kernel.gravity(numpy.zeros((0, 2))).shape == (0, 2)
    assert robot.kernel([4]).mass_matrix([[0.1], [0.2]]).shape == (2, 1, 1)
    with pytest.raises(dynid.Error, match="its last axis is that of the 2 free joints"):
        kernel.gravity(numpy.zeros((4, 3)))
    with pytest.raises(dynid.Error, match="give both for the same states"):
        kernel.forward_dynamics(q, dq[0], tau)
    with pytest.raises(dynid.Error, match="no free joints"):
        robot.kernel([7])


def test_derivatives(robot: dynid.Device) -> None:
    kernel = robot.kernel([2, 4, 5], locked=[0.3, -0.2, 0, 0.5, 0, 0])
    point = states(40, 3)
    step = 1e-6
    for function, derivatives in [
        (kernel.forward_dynamics, kernel.forward_dynamics_derivatives),
        (kernel.inverse_dynamics, kernel.inverse_dynamics_derivatives),
    ]:
        value, *by = derivatives(*point)
        numpy.testing.assert_allclose(value, function(*point), rtol=1e-12)
        for which in range(3):
            for joint in range(3):
                moved = [[own.copy() for own in point] for _ in range(2)]
                moved[0][which][:, joint] += step
                moved[1][which][:, joint] -= step
                slope = (function(*moved[0]) - function(*moved[1])) / (2 * step)
                # What a difference quotient loses to rounding and to its step.
                off = 1e-9 * abs(value).max() + 1e-6 * abs(slope).max()
                numpy.testing.assert_allclose(by[which][:, :, joint], slope, rtol=0, atol=off)


def test_a_model_has_its_own_values(robot: dynid.Device) -> None:
    model = dynid.Model(robot)
    heavier = model.with_values({"link.7.m": 1.4 * model["link.7.m"]})
    q = GENERATOR.uniform(-1, 1, (10, 6))
    assert abs(heavier.kernel().gravity(q) - model.kernel().gravity(q)).max() > 1e-4


def cost(residuals: dynid.Residuals, x: numpy.ndarray) -> float:
    return 0.5 * float(residuals(x) @ residuals(x))


def test_scipy_reaches_the_optimum_of_the_position_error(tour: Path, believed: dynid.Model) -> None:
    logs = dynid.Experiment.load(tour / "experiment.toml")
    ours = dynid.fit(believed, logs, error="position", substeps=4)
    residuals = dynid.Residuals(believed, logs, error="position", substeps=4)
    assert residuals.names[0] == "joint.4.spring.Ks" and residuals.names[-1] == "wrist-2.csv: q5 at the start"
    found = least_squares(residuals, residuals.start, jac=residuals.jacobian, bounds=residuals.bounds, x_scale="jac", xtol=1e-14, ftol=1e-14)
    # A fit tells the cost of the data; the rest of the residuals are its prior.
    n_parameters = len(ours.json()["parameters"])
    data = residuals(found.x)[:-n_parameters]
    assert ours.cost is not None and abs(0.5 * float(data @ data) - ours.cost) < 1e-6 * ours.cost
    theirs = residuals.model(found.x)
    for own in ours.json()["parameters"]:
        assert abs(theirs[own["name"]] - own["value"]) < 0.02 * own["std_error"]


def test_scipy_reaches_the_optimum_of_the_torque_error(tour: Path, believed: dynid.Model) -> None:
    logs = dynid.Experiment.load(tour / "experiment.toml")
    ours = dynid.fit(believed, logs, error="torque")
    residuals = dynid.Residuals(ours.model, logs, error="torque")
    assert ours.cost is not None and abs(cost(residuals, residuals.start) - ours.cost) < 1e-6 * ours.cost
    lower, upper = residuals.bounds
    start = numpy.clip(1.2 * residuals.start, lower, upper)
    found = least_squares(residuals, start, jac=residuals.jacobian, bounds=(lower, upper), x_scale="jac", xtol=1e-14, ftol=1e-14)
    assert abs(found.cost - ours.cost) < 1e-6 * ours.cost


def test_residuals_say_what_they_need(tour: Path, believed: dynid.Model) -> None:
    logs = dynid.Experiment.load(tour / "experiment.toml")
    residuals = dynid.Residuals(believed, logs)
    with pytest.raises(dynid.Error, match="give one for each of the 10 unknowns"):
        residuals([1.0])
    with pytest.raises(dynid.Error, match='expected "position" or "torque"'):
        dynid.Residuals(believed, logs, error="prediction")  # type: ignore[arg-type]
    with pytest.raises(dynid.Error, match="no run has just the joints"):
        dynid.Residuals(believed, logs, free=[1])
