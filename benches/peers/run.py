"""Measures the peers on the work of `peers_work` (its JSON in the file that the argument names) and prints JSON.

Run by `cargo xtask bench --peers`, in a virtual environment with requirements.txt. CPU seconds of one core; the best of
five where a run is repeatable. A peer that is missing says why; one that computes another motion is no peer: `away` is
the largest difference of the final positions from ours (rad).
"""

import json
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


def compiled(name, text, suffix, compiler, flags, robot, work):
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        commands = np.array(work["commands"], dtype=float)
        commands.tofile(folder / "commands.bin")
        (folder / "numbers.h").write_text(numbers(robot, work["start"], len(commands) // 6))
        (folder / f"{name}{suffix}").write_text(text)
        shutil.copy(HERE / "simulation.h", folder)
        program = folder / name
        # For the plain processor of the platform, as a release build of ours.
        subprocess.run([compiler, "-O3", "-I", folder, folder / f"{name}{suffix}", "-o", program, *flags], check=True)
        result = json.loads(subprocess.run([program, folder / "commands.bin"], check=True, capture_output=True).stdout)
    result["away"] = float(np.max(np.abs(np.array(result.pop("last")) - np.array(work["last"]))))
    return result


def casadi_c(robot, work):
    import casadi_c as peer

    if not (compiler := shutil.which("cc")):
        raise RuntimeError("there is no C compiler (cc)")
    return compiled("casadi_peer", peer.source(robot), ".c", compiler, ["-lm"], robot, work["simulate"])


def pinocchio(robot, work):
    import pinocchio as module
    import pinocchio_cpp as peer

    if not (compiler := shutil.which("c++")):
        raise RuntimeError("there is no C++ compiler (c++)")
    prefix = next(p for p in map(Path, module.__path__) for p in p.parents if (p / "include" / "pinocchio").exists())
    # Its algorithms are in its library, compiled with all optimisations; only the calls are compiled here.
    flags = ["-O2", "-std=c++17", "-w", "-DNDEBUG", "-DPINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION"]
    # The header list of joints is longer than what Boost has prepared.
    flags += ["-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS", "-DBOOST_MPL_LIMIT_LIST_SIZE=30"]
    flags += ["-I", prefix / "include", "-I", prefix / "include" / "eigen3"]
    libraries = sorted((prefix / "lib").glob("libpinocchio_default.so*"))[:1]
    flags += [*libraries, f"-Wl,-rpath,{prefix / 'lib'}", f"-Wl,-rpath-link,{prefix / 'lib'}"]
    return compiled("pinocchio_peer", peer.source(robot), ".cpp", compiler, flags, robot, work["simulate"])


def numba(robot, work):
    import numba_fit as peer

    return peer.measure(robot, work["fit"])


def main():
    work = json.loads(Path(sys.argv[1]).read_text())
    robot = Robot()
    results = {}
    for name, peer in (("casadi", casadi_c), ("pinocchio", pinocchio), ("numba", numba)):
        try:
            results[name] = peer(robot, work)
        except Exception as error:  # whatever it is, it is why this peer is missing
            results[name] = {"missing": f"{type(error).__name__}: {error}"}
    print(json.dumps(results))


if __name__ == "__main__":
    main()
