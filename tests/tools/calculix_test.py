"""The tutorial's way from a surface to a solver's result, on a bar whose answer is known.

Usage: calculix_test.py EXAMPLES LOCVOL TUTORIAL   EXAMPLES: tools/examples/calculix; skipped
without ccx
"""
import json
import math
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

EXAMPLES, LOCVOL, TUTORIAL = (pathlib.Path(argument) for argument in sys.argv[1:4])
sys.path.insert(0, str(EXAMPLES))
from result import Result  # noqa: E402

SKIPPED = 77  # what ctest takes for it

# Of 8 by 1 by 1.
BAR = """OFF
8 12 0
0 0 0
8 0 0
8 1 0
0 1 0
0 0 1
8 0 1
8 1 1
0 1 1
3 0 2 1
3 0 3 2
3 4 5 6
3 4 6 7
3 0 1 5
3 0 5 4
3 1 2 6
3 1 6 5
3 2 3 7
3 2 7 6
3 3 0 4
3 3 4 7
"""
FORCE, YOUNG = 100.0, 1000.0


class Bar(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.directory = pathlib.Path(cls.scratch.name)
        (cls.directory / "bar.off").write_text(BAR, encoding="ascii")
        for order in 1, 2:
            cls.run_in(LOCVOL, "mesh", "bar.off", "-o", f"bar{order}.inp", "--size", "25%", "--quiet",
                       "--order", order)  # fmt: skip

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    @classmethod
    def run_in(cls, *arguments):
        done = subprocess.run(
            [str(a) for a in arguments], cwd=cls.directory, capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            raise AssertionError(f"{arguments} failed:\n{done.stdout}{done.stderr}")
        return done.stdout

    def solve(self, force, order):
        """The reaction, the mean displacement of the nodes at the end, and the largest stress."""
        self.run_in(
            sys.executable, "-B", EXAMPLES / "case.py", f"bar{order}.inp", "-o", "case.inp",
            "--hold", "x<0.5", "--load", "x>7.5", "--force", force, "--young", YOUNG,
        )  # fmt: skip
        self.run_in("ccx", "case")
        forces = (self.directory / "case.dat").read_text(encoding="ascii").split()[-3:]
        text = self.run_in(sys.executable, "-B", EXAMPLES / "result.py", "case.frd", "-o", "case.vtu")
        with open(self.directory / "case.frd", encoding="ascii") as frd:
            result = Result(frd)
        displacements = result.fields["DISP"]
        largest = max(math.hypot(*displacement[:3]) for displacement in displacements.values())
        printed, stress = re.findall(r"[-+.e\d]+(?=[,\n])", text)
        self.assertAlmostEqual(float(printed), largest, delta=1e-5 * largest)
        at_end = [n for n, place in result.nodes.items() if place[0] > 7.5]
        mean = [sum(displacements[n][axis] for n in at_end) / len(at_end) for axis in range(3)]
        return [float(f) for f in forces], mean, float(stress)

    # Held up to x = 0.5, and pulled along the last 0.5: so 7.25 of it stretch. The mesh cuts the
    # corners of the section, so the bar is a little thinner.
    def test_pulled_bar_gets_longer_as_hooke_says(self):
        stretched = FORCE * 7.25 / YOUNG
        for order in 1, 2:
            with self.subTest(order=order):
                reaction, displacement, stress = self.solve(f"{FORCE},0,0", order)
                self.assertAlmostEqual(reaction[0], -FORCE, delta=1e-3)
                self.assertGreater(displacement[0], stretched)
                self.assertLess(displacement[0], 1.12 * stretched)
                self.assertGreater(stress, FORCE)
                self.assertLess(stress, 3 * FORCE)

    # A cantilever of 7.25.
    def test_bent_bar_is_too_stiff_with_linear_elements(self):
        bent = -(7.25**3) / 3 / (YOUNG / 12)
        stiff = self.solve("0,0,-1", 1)[1][2] / bent
        right = self.solve("0,0,-1", 2)[1][2] / bent
        self.assertLess(stiff, 0.9 * right)
        self.assertGreater(right, 1.0)
        self.assertLess(right, 1.3)

    def test_empty_region_is_named(self):
        with self.assertRaisesRegex(AssertionError, "region of --load"):
            self.run_in(
                sys.executable, "-B", EXAMPLES / "case.py", "bar1.inp", "-o", "case.inp",
                "--hold", "x<0.5", "--load", "x>9", "--force", "1,0,0",
            )  # fmt: skip


class Patch(unittest.TestCase):
    """The file as locvol writes it, included: a displacement that is linear in space, given on the
    boundary, has one stress everywhere, also in cells whose edges are curved."""

    YOUNG, POISSON = 1000.0, 0.3
    GRADIENT = ((2e-3, 1e-3, 0.0), (0.0, -1e-3, 5e-4), (1e-3, 0.0, 3e-3))  # of u by x, y, z

    def stress(self):
        strain = [[(self.GRADIENT[i][j] + self.GRADIENT[j][i]) / 2 for j in range(3)] for i in range(3)]
        shear = self.YOUNG / 2 / (1 + self.POISSON)
        bulk = 2 * shear * self.POISSON / (1 - 2 * self.POISSON) * sum(strain[i][i] for i in range(3))
        return [2 * shear * strain[i][j] + bulk * (i == j)
                for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))]  # fmt: skip

    def test_linear_displacement_has_one_stress(self):
        with tempfile.TemporaryDirectory() as name:
            directory = pathlib.Path(name)
            for command in (
                ["generate", "sphere", "-o", "ball.stl", "--triangles", "5k"],
                ["mesh", "ball.stl", "-o", "ball.inp", "--size", "20%", "--order", "2", "--quiet"],
            ):
                subprocess.run([LOCVOL, *command], cwd=directory, capture_output=True, check=True)
            text = (directory / "ball.inp").read_text(encoding="ascii")
            self.assertIn("TYPE=C3D10", text)
            points = dict(re.findall(r"^(\d+), ([^,\n]+, [^,\n]+, [^,\n]+)$",
                                     text.split("*NODE")[1].split("*ELEMENT")[0], re.MULTILINE))
            held = re.findall(r"\d+", text.split("*NSET, NSET=boundary\n")[1].split("*")[0])
            with open(directory / "case.inp", "w", encoding="ascii") as case:
                case.write(
                    "*INCLUDE, INPUT=ball.inp\n*MATERIAL, NAME=material\n*ELASTIC\n"
                    f"{self.YOUNG}, {self.POISSON}\n*SOLID SECTION, ELSET=volume, MATERIAL=material\n"
                    "*STEP\n*STATIC\n*BOUNDARY\n"
                )
                for node in held:
                    place = [float(c) for c in points[node].split(",")]
                    for axis, row in enumerate(self.GRADIENT):
                        u = sum(g * c for g, c in zip(row, place))
                        case.write(f"{node}, {axis + 1}, {axis + 1}, {u:.12g}\n")
                case.write("*EL PRINT, ELSET=volume\nS\n*END STEP\n")
            done = subprocess.run(["ccx", "case"], cwd=directory, capture_output=True, text=True,
                                  check=False)  # fmt: skip
            self.assertEqual(done.returncode, 0, done.stdout)
            self.assertNotIn("nonpositive jacobian", done.stdout)
            expected = self.stress()
            rows = [line.split() for line in
                    (directory / "case.dat").read_text(encoding="ascii").splitlines()]  # fmt: skip
            stresses = [[float(s) for s in row[2:]] for row in rows if len(row) == 8]
            self.assertGreater(len(stresses), 4 * 200)  # at four points of each element
            for found in stresses:
                # As ccx prints them: xx, yy, zz, xy, xz, yz. It integrates at four points, which is
                # not exact where edges are curved: in a cube, all are within 1e-6.
                for a, b in zip(found, expected[:4] + [expected[5], expected[4]]):
                    self.assertAlmostEqual(a, b, delta=2e-3)


def run_section(heading, directory, num_commands):
    """Runs the commands of a section of the tutorial, as they stand there."""
    for script in EXAMPLES.glob("*.py"):
        shutil.copy(script, directory)
    section = TUTORIAL.read_text(encoding="utf-8").split(heading)[1].split("\n## ")[0]
    commands = re.findall(r"^```\n(.*?)^```$", section, re.DOTALL | re.MULTILINE)
    if len(commands) != num_commands:
        raise AssertionError(f"{heading}: {len(commands)} blocks of commands")
    path = f"{LOCVOL.resolve().parent}:{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-e", "-c", "\n".join(commands)], cwd=directory, capture_output=True,
        text=True, check=False, env={**os.environ, "PATH": path},
    )  # fmt: skip
    if done.returncode != 0:
        raise AssertionError(done.stdout + done.stderr)
    return done.stdout


class Bracket(unittest.TestCase):
    def check_load(self, results, told):
        forces = results.read_text(encoding="ascii").split()[-3:]
        self.assertAlmostEqual(float(forces[2]), 500, delta=1e-2)
        # Where the fillet begins, the shelf is a beam of 40 by 8 with a moment of 10,500 N mm:
        # 25 N/mm². Quadratic elements have 30 in the fillet, linear ones less.
        stress = float(re.findall(r"Mises stress ([-+.e\d]+)", told)[0])
        self.assertGreater(stress, 22)
        self.assertLess(stress, 31)

    def test_is_loaded_and_held_by_names(self):
        with tempfile.TemporaryDirectory() as name:
            directory = pathlib.Path(name)
            told = run_section("## A part by the names of its faces", directory, 2)
            self.assertIn("fillet: 24 triangles", told)
            self.check_load(directory / "bracket-case.dat", told)
            faces = json.loads((directory / "bracket.inp.faces.json").read_text(encoding="utf-8"))
            shapes = {face["name"]: face["shape"] for face in faces["faces"]}
            self.assertEqual(shapes["fillet"]["kind"], "cylinder")
            self.assertTrue(shapes["fillet"]["is_hollow"])
            self.assertAlmostEqual(shapes["fillet"]["radius"], 10, delta=1e-3)
            self.assertEqual(shapes["back"]["normal"], [-1, 0, 0])

    def test_is_read_as_step(self):
        if not (LOCVOL.resolve().parent / "../lib/locvol/locvol-cad").exists():
            self.skipTest("needs OpenCASCADE. To run it: tools/setup.sh && tools/test.sh -R calculix")
        with tempfile.TemporaryDirectory() as name:
            directory = pathlib.Path(name)
            told = run_section("## A part from a CAD program", directory, 2)
            self.assertIn("near", (directory / "fine.txt").read_text(encoding="ascii"))
            self.check_load(directory / "part-case.dat", told)
            faces = json.loads((directory / "part.inp.faces.json").read_text(encoding="utf-8"))
            shapes = {face["name"]: face["shape"] for face in faces["faces"]}
            self.assertEqual(len(shapes), 9)
            self.assertAlmostEqual(shapes["fillet"]["radius"], 10, delta=1e-2)
            # A face by its number, and one by a place: half as large as those around.
            sizes = {face["name"]: face["area"] / face["num_facets"] for face in faces["faces"]}
            for name in "shelf", "front":
                self.assertLess(sizes[name], 0.8 * sizes["below"])

    def test_unknown_sheet_is_refused_with_those_there_are(self):
        with self.assertRaisesRegex(AssertionError, "there is no sheet 'top': boundary, sheet_1"):
            Bar.setUpClass()
            self.addCleanup(Bar.tearDownClass)
            Bar.run_in(
                sys.executable, "-B", EXAMPLES / "case.py", "bar2.inp", "-o", "case.inp",
                "--hold", "top", "--load", "x>7.5", "--force", "1,0,0",
            )  # fmt: skip


class Layers(unittest.TestCase):
    """Three bodies, of which the heat flows through one after another, as in the closed form."""

    THICKNESS, CONDUCTIVITY, AREA = (0.02, 0.08, 0.1), (0.5, 0.04, 0.8), 0.04

    def test_conduct_heat_as_fourier_says(self):
        resistance = [d / k for d, k in zip(self.THICKNESS, self.CONDUCTIVITY)]
        flux = 30 / sum(resistance)
        with tempfile.TemporaryDirectory() as name:
            directory = pathlib.Path(name)
            run_section("## Heat through layers", directory, 1)
            text = (directory / "wall-case.dat").read_text(encoding="ascii")
            temperatures = {}
            for block in text.split(" temperatures for set ")[1:]:
                rows = [line.split() for line in block.split(" total ")[0].splitlines()[1:]]
                temperatures[block.split()[0]] = [float(row[1]) for row in rows if len(row) == 2]
            expected = {"PLASTER_6": 20 - flux * resistance[0],
                        "FOAM_5": -10 + flux * resistance[2]}  # fmt: skip
            self.assertEqual(temperatures.keys(), expected.keys())
            for sheet, values in temperatures.items():
                self.assertGreater(len(values), 50)
                for value in values:
                    self.assertAlmostEqual(value, expected[sheet], delta=1e-5)
            heat = [float(block.split()[-1]) for block in re.split(" total heat.*\n", text)[1:]]
            self.assertEqual(len(heat), 2)
            self.assertAlmostEqual(heat[0], flux * self.AREA, delta=1e-6)
            self.assertAlmostEqual(heat[1], -flux * self.AREA, delta=1e-6)


if __name__ == "__main__":
    if not shutil.which("ccx"):
        print("skipped: needs ccx, of CalculiX. To run it: "
              "tools/setup.sh calculix-ccx && tools/test.sh -R tools/calculix")
        sys.exit(SKIPPED)
    unittest.main(argv=sys.argv[:1])
