"""The examples for Python, against what is known.

Usage: examples_test.py EXAMPLES PACKAGE NAME   EXAMPLES: tools/examples/python; NAME: one of them;
exit code 77: what it needs is not installed
"""
import importlib.util
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

EXAMPLES, PACKAGE = (pathlib.Path(argument).resolve() for argument in sys.argv[1:3])
NAME = sys.argv[3]
sys.path[:0] = [str(PACKAGE), str(EXAMPLES), str(EXAMPLES.parent / "calculix")]

SKIPPED = 77  # what ctest takes for it
HEAT = 469.05  # through the bracket, at the size of the examples


def need(is_there, what, package):
    if not is_there:
        print(f"skipped: needs {what}. To run it: "
              f"tools/setup.sh {package} && tools/test.sh -R tools/python_{NAME}")
        sys.exit(SKIPPED)


def run(*arguments):
    """What the example prints."""
    environment = {**os.environ, "PYTHONPATH": f"{PACKAGE}:{os.environ.get('PYTHONPATH', '')}"}
    with tempfile.TemporaryDirectory() as scratch:
        done = subprocess.run(
            [sys.executable, "-B", EXAMPLES / f"{NAME}.py", *arguments], cwd=scratch,
            env=environment, capture_output=True, text=True, check=False)  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def numbers(pattern, text):
    found = re.search(pattern, text)
    assert found, f"{pattern} is not in:\n{text}"
    return [float(number) for number in found.groups()]


def test_poisson():
    need(importlib.util.find_spec("scipy"), "scipy", "python3-scipy")
    told = run()
    low, high = numbers(r"from (\S+) to (\S+)", told)
    assert (low, high) == (20, 100), told
    (out,), (heat,) = numbers(r"at back: (\S+)", told), numbers(r"at tip: (\S+)", told)
    assert abs(out + heat) < 1e-3 and abs(heat - HEAT) < 0.5, told

    # A linear temperature is one of linear elements, so they have it exactly.
    import locvol
    import numpy as np
    import poisson

    surface, groups, names = poisson.bracket()
    mesh = locvol.mesh(surface, "30%", groups=groups, names=names)

    def linear(points):
        return points @ (1.0, -2.0, 0.5) + 3

    values, _ = poisson.solve(mesh, dict.fromkeys(names, linear))
    np.testing.assert_allclose(values, linear(mesh.points), atol=1e-6)


def test_poisson_fenicsx():
    need(importlib.util.find_spec("dolfinx"), "FEniCSx", "python3-dolfinx")
    told = run()
    (heat,) = numbers(r"at tip: ([-.\d]+)", told)
    assert abs(heat - HEAT) < 0.5, told


def test_stresses():
    need(shutil.which("ccx"), "ccx, of CalculiX", "calculix-ccx")
    need(importlib.util.find_spec("scipy"), "scipy", "python3-scipy")
    # Where the fillet begins, the shelf is a beam of 40 by 8 with a moment of 10,500 N mm: 25 N/mm²,
    # and somewhat more in the fillet.
    told = run()
    (stress,) = numbers(r"largest stress: (\S+)", told)
    assert 25 < stress < 32, told
    (deflection,) = numbers(r"deflection: (\S+)", told)
    assert -0.04 < deflection < -0.02, told


globals()[f"test_{NAME}"]()
