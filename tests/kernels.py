"""Which kernels of OpenBLAS, and which code of numba, this machine can run: `python -m tests.kernels`.

Other processors round in another order. OPENBLAS_CORETYPE asks the library for another processor's
kernels; it may ignore that, or take kernels whose instructions this processor lacks. So each is
tried in a process of its own, which computes with them and tells which ones it got.
"""

import ctypes
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.linalg

KERNELS = (  # of x86-64, as OpenBLAS names them in driver/others/dynamic.c
    "Prescott",
    "Nehalem",
    "Sandybridge",
    "Haswell",
    "Zen",
    "SkylakeX",
    "Cooperlake",
    "Sapphirerapids",
)
STANDS_FOR = {"Katmai": "Prescott"}  # one table serves both where the older kernels were not built
CORENAMES = ("openblas_get_corename", "scipy_openblas_get_corename")
SUFFIXES = ("", "64_")  # of builds with 64-bit integers
TRY_S = 120.0  # it takes 1 s; a machine with many times as much work as processors is no failure


class Kernel(NamedTuple):
    """A kind of rounding: environment to run with, or why it cannot be had here."""

    name: str
    environment: dict[str, str]
    refused: str = ""


def corenames() -> list[str]:
    """The kernels that this process computes with: one name for each OpenBLAS that it loaded."""
    names = []
    for path in sorted(_loaded_libraries()):
        library = ctypes.CDLL(path)
        for symbol in (name + suffix for name in CORENAMES for suffix in SUFFIXES):
            if hasattr(library, symbol):
                tell = getattr(library, symbol)
                tell.restype = ctypes.c_char_p
                names.append(tell().decode())
    return names


def _loaded_libraries() -> set[str]:
    lines = Path("/proc/self/maps").read_text().splitlines()
    return {line.split()[-1] for line in lines if "openblas" in line.lower()}


def compute() -> None:
    """Use what the solvers use, so that an instruction that is missing here ends this process."""
    rng = np.random.default_rng(1)
    A, b = rng.normal(size=(160, 40)), rng.normal(size=160)
    x = np.linalg.lstsq(A, b, rcond=None)[0]
    S = A.T @ A
    for other in (
        np.linalg.solve(S, A.T @ b),
        scipy.linalg.cho_solve(scipy.linalg.cho_factor(S), A.T @ b),
    ):
        np.testing.assert_allclose(other, x, rtol=1e-9)
    U, s, Vt = scipy.linalg.svd(A, full_matrices=False)
    np.testing.assert_allclose((U * s) @ Vt, A, atol=1e-12)
    np.testing.assert_allclose(np.linalg.eigvalsh(S), np.sort(s**2), rtol=1e-9)


def tried(name: str) -> Kernel:
    """The kernel by that name, tried in a process of its own."""
    environment = {"OPENBLAS_CORETYPE": name}
    argv = [sys.executable, "-m", "tests.kernels", "--compute"]
    try:
        run = subprocess.run(
            argv,
            env=os.environ | environment,
            capture_output=True,
            text=True,
            timeout=TRY_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Kernel(name, environment, f"did not end within {TRY_S:g} s")
    if run.returncode < 0:
        return Kernel(
            name, environment, f"this processor lacks its instructions (signal {-run.returncode})"
        )
    if run.returncode:
        return Kernel(name, environment, f"wrong results: {run.stderr.strip().splitlines()[-1]}")
    got = {STANDS_FOR.get(one, one) for one in run.stdout.split()}
    if got != {name}:
        return Kernel(
            name, environment, f"not honoured, the library takes {', '.join(sorted(got))}"
        )
    return Kernel(name, environment)


def kernels() -> list[Kernel]:
    """All that are known, each with its environment or why it is not to be had."""
    if platform.machine() not in ("x86_64", "AMD64"):
        why = f"{platform.machine()}: not run, its kernels are not tried yet"
        return [Kernel(name, {}, why) for name in KERNELS]
    if not sys.platform.startswith("linux"):
        return [Kernel(name, {}, f"{sys.platform}: not run") for name in KERNELS]
    return [tried(name) for name in KERNELS]


if __name__ == "__main__":
    if "--compute" in sys.argv:
        compute()
        print(*corenames())
    else:
        print("without asking:", *corenames())
        for kernel in kernels():
            print(f"{kernel.name}: {kernel.refused or 'run'}")
