"""Devices, models, pickles, progress, interrupts."""

from __future__ import annotations

import _thread
import os
import pickle
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import dynid
import numpy
import pytest

URDF = """<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 0.1"/><mass value="1.2"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0 0 0.1"/><mass value="0.6"/>
    <inertia ixx="0.004" iyy="0.004" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="20" velocity="3"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="10" velocity="3"/></joint>
</robot>"""


@pytest.fixture
def arm(tmp_path: Path) -> dynid.Device:
    (tmp_path / "arm.urdf").write_text(URDF)
    return dynid.Device.from_urdf(tmp_path / "arm.urdf")


def again(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))


def test_devices_that_ship(robot: dynid.Device) -> None:
    assert "freedom6s" in dynid.devices and len(dynid.devices) == len(list(dynid.devices))
    assert len(robot.joints) == 6 and robot == again(robot) and robot != dynid.devices["planar2r"]
    with pytest.raises(KeyError):
        dynid.devices["freedom7s"]


def test_a_robot_of_ones_own_needs_no_file(arm: dynid.Device, tmp_path: Path) -> None:
    model = dynid.Model(arm, effects=[dynid.Effect("viscous", joint=0, Fv=0.1)])
    assert (arm.id, arm.joints, model["joint.0.viscous.Fv"]) == ("arm", ["shoulder", "elbow"], 0.1)
    with pytest.raises(dynid.Error, match="write it first"):
        model.save(tmp_path / "model.toml")
    assert not (tmp_path / "model.toml").exists()
    arm.save()
    model.save(tmp_path / "model.toml")
    assert dynid.Model.load(tmp_path / "model.toml") == model
    with pytest.raises(dynid.Error, match="exists already and is kept; .*overwrite=True"):
        model.save(tmp_path / "model.toml")
    model.save(tmp_path / "model.toml", overwrite=True)
    assert dynid.Device.load(tmp_path / "arm.toml") == arm


def test_models(robot: dynid.Device, believed: dynid.Model) -> None:
    more = believed.add(dynid.Effect("coulomb", joint=4, Fc=0.01))
    assert more["joint.4.coulomb.Fc"] == 0.01 and more != believed and more.remove("coulomb", 4) == believed
    assert believed.with_values({"joint.4.spring.Ks": 0.03})["joint.4.spring.Ks"] == 0.03
    assert dynid.Effect("gain", joint=4, Kp=7.15) in believed.effects
    for wrong, said in [
        (lambda: dynid.Model(robot, effects=[dynid.Effect("viscos", joint=0)]), "viscous"),
        (lambda: dynid.Model(robot, effects=[dynid.Effect("viscous", joint=9)]), "has no joint 9"),
        (lambda: dynid.Model(robot, effects=[dynid.Effect("viscous", joint=0, Fw=1.0)]), "has no `Fw`; it has Fv"),
        (lambda: dynid.Model(robot, effects=[dynid.Effect("viscous", joint=0, Fv=-1.0)]), "lies between"),
        (lambda: believed["joint.4.spring.K"], "unknown parameter"),
        (lambda: dynid.Model.load("none.toml"), "cannot read none.toml"),
        (lambda: dynid.Device.load("robot.urdf"), "Device.from_urdf"),
        (lambda: dynid.Effect("viscous", joint=-1), "expected an index or a count from 0 to"),
        (lambda: robot.kernel(free=[2**70]), "expected an index or a count from 0 to"),
    ]:
        with pytest.raises(dynid.Error, match=said):
            wrong()  # type: ignore[no-untyped-call]


def test_pickles(arm: dynid.Device, tour: Path, logs: dynid.Experiment, fitted: dynid.Fitted, found: dynid.Diagnosis) -> None:
    assert again(fitted.model) == fitted.model and again(fitted.model).as_toml() == fitted.model.as_toml()
    model = dynid.Model(arm)
    assert again(model) == model and again(arm) == arm
    assert again(dynid.Effect("input_coupling", joint=4, from_=5, gain=0.5)) == dynid.Effect("input_coupling", 4, 5, gain=0.5)
    back = again(logs)
    assert (back.digest, back.runs) == (logs.digest, logs.runs)
    assert dynid.fit(fitted.model, back).json() == dynid.fit(fitted.model, logs).json()
    assert again(dynid.Experiment(arm)).runs == []
    assert again(found).best.effect == found.best.effect and again(fitted).json() == fitted.json()


def test_progress_is_heard_in_the_thread_that_called(logs: dynid.Experiment, believed: dynid.Model, fitted: dynid.Fitted) -> None:
    heard: list[tuple[dict[str, Any], int]] = []
    dynid.fit(believed, logs, progress=lambda event: heard.append((event, threading.get_ident())))
    dynid.compare(believed, logs, progress=lambda event: heard.append((event, threading.get_ident())))
    kinds = {event["progress"] for event, _ in heard}
    assert kinds == {"search", "iteration", "count"} and {thread for _, thread in heard} == {threading.get_ident()}
    assert dynid.fit(believed, logs, progress=True).json() == fitted.json()


def test_what_a_listener_raises_ends_the_work(logs: dynid.Experiment, fitted: dynid.Fitted) -> None:
    def listener(event: dict[str, Any]) -> None:
        raise LookupError(event["progress"])

    begun = time.monotonic()
    with pytest.raises(LookupError, match="fitting_model"):
        dynid.diagnose(fitted.model, logs, progress=listener)
    assert time.monotonic() - begun < 5.0


def test_other_threads_run_meanwhile(logs: dynid.Experiment, fitted: dynid.Fitted) -> None:
    ticks = 0
    done = threading.Event()

    def tick() -> None:
        nonlocal ticks
        while not done.wait(0.01):
            ticks += 1

    thread = threading.Thread(target=tick)
    thread.start()
    dynid.diagnose(fitted.model, logs)
    done.set()
    thread.join()
    assert ticks > 20


def test_ctrl_c(logs: dynid.Experiment, fitted: dynid.Fitted) -> None:
    begun = time.monotonic()
    timer = threading.Timer(0.5, _thread.interrupt_main)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        for _ in range(100):
            dynid.diagnose(fitted.model, logs)
    assert time.monotonic() - begun < 5.0


def test_a_stopped_fit_goes_on_to_the_same_bits(tour: Path, logs: dynid.Experiment, believed: dynid.Model, tmp_path: Path) -> None:
    events = 0

    def stop(event: dict[str, Any]) -> None:
        nonlocal events
        events += 1
        if events == 5:
            raise KeyboardInterrupt

    whole = dynid.fit(believed, logs, error="position")
    checkpoint = tmp_path / "fit.checkpoint"
    with pytest.raises(KeyboardInterrupt):
        dynid.fit(believed, logs, error="position", checkpoint=checkpoint, progress=stop)
    assert checkpoint.exists()
    assert dynid.fit(believed, logs, error="position", checkpoint=checkpoint, resume=True).json() == whole.json()
    assert not checkpoint.exists()


def test_packages_that_are_not_there_are_named(logs: dynid.Experiment, fitted: dynid.Fitted, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("pandas", "matplotlib.pyplot", "tqdm.auto"):
        monkeypatch.setitem(sys.modules, module, None)
    for use, package in [
        (lambda: fitted.parameters, "pandas"),
        (lambda: fitted.model.parameters, "pandas"),
        (lambda: fitted.plot(), "matplotlib"),
        (lambda: dynid.compare(fitted.model, logs, progress=True), "tqdm"),
    ]:
        with pytest.raises(dynid.Error, match=f"needs the package {package}; install it"):
            use()  # type: ignore[no-untyped-call]


def test_a_fit_that_is_no_minimum_changes_no_model(logs: dynid.Experiment, believed: dynid.Model) -> None:
    fitted = dynid.fit(believed, logs, error="position", iterations=1)
    with pytest.raises(dynid.Error, match="did not end at a minimum"):
        _ = fitted.model


LEAK = """
import resource, sys
import dynid
folder = sys.argv[1]
logs = dynid.Experiment.load(folder + "/experiment.toml")
model = dynid.Model.load(folder + "/believed.toml")
columns = {name: values for name, values in logs.columns(0).items()}
def work(count):
    for _ in range(count):
        small = dynid.Experiment(logs.device).add(columns, role="fit", free=[4, 5], rows=(0, 200))
        dynid.fit(model, small, error="torque", progress=lambda event: None).model.as_toml()
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize()
work(200)
before = work(100)
after = work(700)
print(before, after)
"""


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the system does not say what is resident")
def test_a_thousand_fits_leak_nothing(tour: Path) -> None:
    done = subprocess.run([sys.executable, "-c", LEAK, str(tour)], capture_output=True, check=True, text=True, env=os.environ)
    before, after = map(int, done.stdout.split())
    assert after - before < 2_000_000, f"{before} bytes became {after}"


def test_arrays_are_not_kept(robot: dynid.Device) -> None:
    q = numpy.zeros((1000, 6))
    before = sys.getrefcount(q)
    robot.kernel().gravity(q)
    assert sys.getrefcount(q) == before
