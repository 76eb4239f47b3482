"""Measures the peers on the work of `peers_work` (its JSON in the file that the argument names) and prints JSON.

Run by `cargo xtask bench --peers`, in a virtual environment with what requirements.txt names, as far as that can be installed. CPU seconds of
one core; the best of five where a run is repeatable. A peer that is missing says why; one that computes another motion is no peer: `away`
is the largest difference of the final positions from ours (rad), `ddq_away` that of the accelerations, as a share of the largest.
"""

import contextlib
import importlib.metadata
import json
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from robot import Robot

HERE = Path(__file__).resolve().parent


def numbers(robot, start, samples):
    """The header that the compiled peers include."""
    lines = ["#define N 6", "#define SUBSTEPS 60", f"#define SAMPLES {samples}"]
    columns = {"Kp": ("gain", "Kp"), "Ks": ("spring", "Ks"), "qeq": ("spring", "qeq")}
    columns |= {symbol: ("lugre", symbol) for symbol in ("sigma0", "sigma1", "sigma2", "vs", "Fs", "Fc")}
    for name, place in columns.items():
        lines.append(f"static const double {name}[N] = {{{', '.join(map(repr, robot.column(*place)))}}};")
    lines.append(f"static const double start[N] = {{{', '.join(map(repr, start))}}};")
    return "\n".join(lines) + "\n"


def compiler(name, what):
    if not (found := shutil.which(name)):
        raise RuntimeError(f"there is no {what} compiler ({name})")
    return found


def compiled(name, text, suffix, compiler, flags, robot, work, files=()):
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        commands = np.array(work["commands"], dtype=float)
        commands.tofile(folder / "commands.bin")
        (folder / "numbers.h").write_text(numbers(robot, work["start"], len(commands) // 6))
        (folder / f"{name}{suffix}").write_text(text)
        for other, content in files:
            (folder / other).write_text(content)
        shutil.copy(HERE / "simulation.h", folder)
        program = folder / name
        # For the plain processor of the platform, as a release build of ours.
        call([compiler, "-O3", "-I", folder, folder / f"{name}{suffix}", "-o", program, *flags], folder)
        result = json.loads(call([program, folder / "commands.bin"], folder))
    result["away"] = float(np.max(np.abs(np.array(result.pop("last")) - np.array(work["last"]))))
    return result


def call(words, folder):
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
    if done.returncode:
        said = done.stderr.strip().splitlines()
        raise RuntimeError(f"{Path(words[0]).name} ended with {done.returncode}: {said[0] if said else 'nothing said'}")
    return done.stdout


def casadi_c(robot, work):
    import casadi_c as peer

    return compiled("casadi_peer", peer.source(robot), ".c", compiler("cc", "C"), ["-lm"], robot, work["simulate"])


def mujoco_c(robot, work):
    import mujoco as module
    import mujoco_c as peer
    from mujoco_robot import document

    prefix = Path(module.__file__).parent
    library = next(iter([*prefix.glob("libmujoco.so*"), *prefix.glob("libmujoco*.dylib")]), None)
    if library is None:
        raise RuntimeError("the package has no library to link")
    flags = ["-I", prefix / "include", library, f"-Wl,-rpath,{prefix}", "-lm"]
    files = [("robot.xml", document(robot))]
    return compiled("mujoco_peer", peer.source(robot), ".c", compiler("cc", "C"), flags, robot, work["simulate"], files)


def pinocchio_cpp(robot, work):
    import pinocchio as module
    import pinocchio_cpp as peer

    prefix = next(p for p in map(Path, module.__path__) for p in p.parents if (p / "include" / "pinocchio").exists())
    # Its algorithms are in its library, compiled with all optimisations; only the calls are compiled here.
    flags = ["-O2", "-std=c++17", "-w", "-DNDEBUG", "-DPINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION"]
    # The header list of joints is longer than what Boost has prepared.
    flags += ["-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS", "-DBOOST_MPL_LIMIT_LIST_SIZE=30"]
    flags += ["-I", prefix / "include", "-I", prefix / "include" / "eigen3"]
    libraries = sorted((prefix / "lib").glob("libpinocchio_default.so*"))[:1]
    flags += [*libraries, f"-Wl,-rpath,{prefix / 'lib'}", f"-Wl,-rpath-link,{prefix / 'lib'}"]
    return compiled("pinocchio_peer", peer.source(robot), ".cpp", compiler("c++", "C++"), flags, robot, work["simulate"])


def pinocchio_python(robot, work):
    import from_python as peer

    return peer.pinocchio(robot, work["forward_dynamics"])


def mujoco_python(robot, work):
    import from_python as peer

    return peer.mujoco(robot, work["forward_dynamics"])


def numba(robot, work):
    import numba_fit as peer

    return peer.measure(robot, work["fit"])


def mujoco_sysid(robot, work):
    import mujoco_sysid as peer

    return peer.measure(robot, work["linear_fit"] | {"start": work["linear_fit"]["position"][0]})


# Name of each peer, what measures it, and the packages whose versions it is.
PEERS = [
    ("CasADi, C", casadi_c, ["casadi"]),
    ("Pinocchio, C++", pinocchio_cpp, ["pin"]),
    ("MuJoCo, C", mujoco_c, ["mujoco"]),
    ("Pinocchio, Python", pinocchio_python, ["pin"]),
    ("MuJoCo, Python", mujoco_python, ["mujoco"]),
    ("numba and scipy", numba, ["numba", "scipy"]),
    ("mujoco.sysid", mujoco_sysid, ["mujoco"]),
]


def version(package):
    try:
        return f"{package} {importlib.metadata.version(package)}"
    except importlib.metadata.PackageNotFoundError:
        return f"{package} is not installed"


def said(name):
    """What a compiler calls itself."""
    found = shutil.which(name)
    return subprocess.run([found, "--version"], capture_output=True, text=True).stdout.splitlines()[0] if found else None


def main():
    work = json.loads(Path(sys.argv[1]).read_text())
    robot = Robot()
    ours = np.array(work["forward_dynamics"]["ddq"])
    results = []
    for name, peer, packages in PEERS:
        try:
            # What a peer prints on the way is not for those who read our JSON.
            with contextlib.redirect_stdout(sys.stderr):
                result = peer(robot, work)
            if "ddq" in result:
                result["ddq_away"] = float(np.max(np.abs(np.array(result.pop("ddq")) - ours)) / np.max(np.abs(ours)))
        except Exception as error:  # whatever it is, it is why this peer is missing
            result = {"missing": f"{type(error).__name__}: {error}"}
        results.append(result | {"name": name, "versions": [version(package) for package in packages]})
    tools = [f"Python {platform.python_version()}", version("numpy"), said("cc"), said("c++")]
    print(json.dumps({"peers": results, "tools": [tool for tool in tools if tool]}))


if __name__ == "__main__":
    main()
