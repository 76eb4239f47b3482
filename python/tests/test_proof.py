"""The scripts of docs/proof run on made-up logs of the same formats, made by simulating the models that they fit."""

from __future__ import annotations

import importlib
import json
import re
import sys
from pathlib import Path
from types import ModuleType

import dynid
import numpy
import pytest

PROOF = Path(__file__).parents[2] / "docs" / "proof"


class Set:
    """Like a data set of nonlinear_benchmarks that does not say its sampling time."""

    def __init__(self, u: numpy.ndarray, y: numpy.ndarray) -> None:
        self.u, self.y, self.sampling_time = u, y, None


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> object:
    """Runs a script as its command does, and returns the rows of its table."""
    monkeypatch.syspath_prepend(str(PROOF))

    def run(name: str, path: Path, *more: str) -> dict[str, list[str]]:
        readme = tmp_path / f"{name}.md"
        monkeypatch.setattr(sys, "argv", [name, str(path), "--readme", str(readme), *more])
        loaded(name).main()
        return table(readme)

    return run


def loaded(name: str) -> ModuleType:
    return importlib.import_module(name)


def table(readme: Path) -> dict[str, list[str]]:
    """Figures by what they are; a published figure of the tests' made-up data means nothing."""
    lines = [line.strip("| ").split(" | ") for line in readme.read_text(encoding="utf-8").splitlines() if line.startswith("|")]
    return {cells[0]: cells[1:] for cells in lines[2:]}


def multisine(t: numpy.ndarray, frequencies: list[float], size: float, phase: float = 0.0) -> numpy.ndarray:
    waves = [numpy.sin(2 * numpy.pi * own * t + phase + 1.7 * number) for number, own in enumerate(frequencies)]
    made: numpy.ndarray = size * numpy.sum(waves, axis=0) / len(frequencies)
    return made


def played(model: dynid.Model, columns: dict[str, numpy.ndarray], free: list[int], **settings: object) -> numpy.ndarray:
    """Positions of a model under torques; it starts at rest at 0, or where `start` says."""
    empty = {f"q{joint}": numpy.zeros(len(columns["t"])) for joint in range(len(model.device.joints))}
    start = [0.0] * len(model.device.joints)
    logs = dynid.Experiment(model.device)
    logs.add({**empty, **columns}, role="validate", free=free, start=start, **settings)  # type: ignore[arg-type]
    return dynid.simulate(model, logs)[0].q


def test_silverbox(script, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    samples = 131072 // 64
    t = numpy.arange(samples) / 610.35
    u = multisine(t, [20.0, 37.0, 55.0, 66.0, 71.0, 90.0, 120.0], 0.15)
    cubic = dynid.devices["oscillator"].model().add(dynid.Effect("spring_cubic", 0, K3=4.0))
    y = played(cubic, {"t": t, "tau0": u}, [0], hold="linear")[:, 0]
    generator = numpy.random.default_rng(1)
    text = "V1,V2,\n" + "".join(f"{a:.6g},{b:.6g},\n" for a, b in zip(u, y + generator.normal(0, 2e-4, samples), strict=True))
    (tmp_path / "SNLS80mV.csv").write_text(text, encoding="utf-8")
    rows = script("silverbox", tmp_path / "SNLS80mV.csv")
    assert float(rows["multisine: with it"][2]) < 0.3 * float(rows["multisine: without the cubic spring"][2])
    assert "spring_cubic" in (tmp_path / "silverbox.md").read_text(encoding="utf-8")


def test_bam(script, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    robot = dynid.devices["servo_pendulum"]
    truth = robot.model().add(dynid.Effect("friction_load", 0, mu=0.3, behind=1.0))
    folder = tmp_path / "raw"
    folder.mkdir()
    for gain, phase in ((200, 0.0), (400, 1.0)):
        t = numpy.arange(0, 3, 0.0053)
        reference = multisine(t, [0.4, 0.9], 1.2, phase) - multisine(t[:1], [0.4, 0.9], 1.2, phase)
        controller = tmp_path / f"{gain}.toml"
        controller.write_text(f"P = [{0.00285 * gain * 7.3}]\nD = [0.0]\nlimit = [7.3]\n", encoding="utf-8")
        columns = {"t": t, "tau0": 0 * t, "q0": 0 * t, "ref0": reference}
        logs = dynid.Experiment(robot).add(columns, role="fit", free=[0], start=[0.0], controller=controller)
        (run,) = dynid.simulate(truth, logs)
        counts = numpy.round(run.tau[:, 0] / 7.3 * 885).astype(int) % 65536
        speeds = numpy.gradient(run.q[:, 0], t)
        entries = [
            {
                "position": q,
                "speed": dq,
                "load": int(load),
                "input_volts": 7.3,
                "timestamp": time,
                "goal_position": goal,
                "torque_enable": True,
            }
            for q, dq, load, time, goal in zip(run.q[:, 0], speeds, counts, t, reference, strict=True)
        ]
        log = {"mass": 0.49, "length": 0.1, "kp": gain, "vin": 7.4, "trajectory": "sin_sin", "entries": entries}
        (folder / f"{gain}.json").write_text(json.dumps(log), encoding="utf-8")
    rows = script("bam", folder)
    assert list(rows)[0].startswith("M1") and len(rows) == 6
    assert float(rows["M3, and load"][2]) < 0.5 * float(rows["M1, Coulomb and viscous"][2])


def test_a_published_friction_model_stops_and_moves(script) -> None:  # type: ignore[no-untyped-def]
    del script
    bam = loaded("bam")
    t = numpy.arange(0, 1, 0.005)
    own = json.loads((PROOF / "bam_xl330.json").read_text(encoding="utf-8"))["M1"] | {"q_offset": 0.0}
    rest = bam.Recording("rest", 100.0, 7.3, {"t": t, "q0": 0 * t, "qd0": 0 * t, "ref0": 0 * t})
    assert bam.published(own, rest, 0.00246) == 0.0
    step = bam.Recording("step", 100.0, 7.3, {"t": t, "q0": 0 * t, "qd0": 0 * t, "ref0": 0 * t + 0.5})
    assert bam.published(own, step, 0.00246) > 0.01


def test_double_pendulum(script, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    truth = dynid.devices["double_pendulum"].model()
    for number, names in enumerate((*loaded("double_pendulum").FIT, *loaded("double_pendulum").TEST)):
        t = numpy.arange(0, 4, 0.02)
        tau = {f"tau{joint}": multisine(t, [0.3, 0.7], 0.9, number + joint) for joint in (0, 1)}
        q = played(truth, {"t": t, **tau}, [0, 1])
        lines = ["time,pos1,pos2,vel1,vel2,tau1,tau2"]
        lines += [",".join(f"{value:.8g}" for value in row) for row in numpy.column_stack([t, q, 0 * q, tau["tau0"], tau["tau1"]])]
        (tmp_path / names[0]).write_text("\n".join(lines) + "\n", encoding="utf-8")
    rows = script("double_pendulum", tmp_path, "--rounds", "0")  # a diagnosis takes a minute
    names = ("the structure without dry friction", "the published structure, fitted")
    without, fitted = (float(rows[f"fast 2, joint 1: {own}"][2]) for own in names)
    assert fitted < 0.8 * without


def test_staubli(script, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    staubli = loaded("staubli")
    t = numpy.arange(5000) / staubli.RATE_HZ
    q = numpy.column_stack([0.4 * numpy.sin(2 * numpy.pi * (1.1 + 0.3 * joint) * t + joint) for joint in range(6)])
    turns = numpy.diag(staubli.RATIOS)
    turns[5, 4] = staubli.RATIOS[5]
    motors = (q - [0, -numpy.pi / 2, numpy.pi / 2, 0, 0, 0]) @ turns.T
    torque = 0.1 * numpy.sign(numpy.gradient(q, axis=0))
    for name, values in (("curr_data", torque), ("pos_read_data", motors)):
        numpy.savetxt(tmp_path / f"{name}.csv", values, delimiter=",", header="a,b,c,d,e,f", comments="")
    columns, files = staubli.read(tmp_path)
    assert len(files) == 2
    numpy.testing.assert_allclose(numpy.column_stack([columns[f"q{joint}"] for joint in range(6)]), q, atol=1e-9)
    numpy.testing.assert_allclose(columns["tau4"], torque[:, 4] * 45 + torque[:, 5] * 32)
    numpy.testing.assert_allclose(columns["tau5"], torque[:, 5] * 32)


def test_industrial_robot(script, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    del script
    robot_script = loaded("industrial_robot")
    # Six joints take minutes; two show that it runs.
    robot = dynid.devices["planar2r"]
    kernel, joints = robot.kernel(), range(2)
    t = numpy.arange(606) * robot_script.SAMPLING_TIME
    sets = []
    for phase in (0.0, 1.0):
        waves = [2 * numpy.pi * (0.11 + 0.03 * joint) for joint in joints]
        q = numpy.column_stack([0.5 * numpy.sin(waves[joint] * t + phase + joint) for joint in joints])
        dq = numpy.column_stack([0.5 * waves[joint] * numpy.cos(waves[joint] * t + phase + joint) for joint in joints])
        ddq = numpy.column_stack([-0.5 * waves[joint] ** 2 * numpy.sin(waves[joint] * t + phase + joint) for joint in joints])
        sets.append(Set(kernel.inverse_dynamics(q, dq, ddq) + 0.2 * dq, numpy.degrees(q)))
    rows, said = robot_script.scored(robot, sets[:1], sets[1:])
    torque = [row.ours for row in rows if row.what.startswith("torque")]
    assert len(torque) == 2 and max(torque) < 20
    assert len(rows) == 4 or said


def test_readme_has_every_table_and_no_path() -> None:
    text = (PROOF / "README.md").read_text(encoding="utf-8")
    for name in ("bam", "silverbox", "double-pendulum", "staubli", "industrial-robot"):
        assert re.search(f"<!-- {name}: begin -->\n.*<!-- {name}: end -->", text, re.DOTALL), name
    for picture in re.findall(r"!\[[^]]*\]\(([^)]*)\)", text):
        assert (PROOF / picture).exists(), picture
