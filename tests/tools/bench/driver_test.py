"""Whole runs of the benchmarks' driver, with peers that are made up here. Run by ctest.

    driver_test.py RUN_BENCHMARKS LOCVOL
"""
import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

DRIVER, LOCVOL = (os.path.abspath(path) for path in sys.argv[1:3])

# As many tetrahedra as a law of volume and area gives; four triangles for a boundary.
CGAL = """
a = dict(zip(sys.argv[2::2], sys.argv[3::2]))
size = float(a["--lambda"])
if "--surface-out" in sys.argv:
    with open(sys.argv[sys.argv.index("--surface-out") + 1], "w") as file:
        file.write("OFF\\n4 4 0\\n0 0 0\\n1 0 0\\n0 1 0\\n0 0 1\\n"
                   "3 0 2 1\\n3 0 1 3\\n3 1 2 3\\n3 2 0 3\\n")
steps = {"load": 1, "tree": 2, "refine": 30, "optimize": 0, "write": 4}
print(json.dumps({"n_tets": round(19 / size**3 + 20 / size**2), "wall_s": steps, "cpu_s": steps,
                  "peak_rss_mb": {step: 7 for step in steps}, "some": float("nan")}))
"""
# Volumes are those that the patches enclose.
CGAL_OF_BODIES = """
volumes, arguments = {}, sys.argv[1:]
for patch in arguments[:arguments.index("--lambda")]:
    name, front, back = patch.split(":")
    head, counts, *lines = open(name)
    points = [list(map(float, line.split())) for line in lines[:int(counts.split()[0])]]
    for line in lines[len(points):]:
        (a, b, c), (d, e, f), (g, h, i) = (points[int(v)] for v in line.split()[1:])
        volume = (a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)) / 6
        for body, sign in ((front, -1), (back, 1)):
            if body != "0":
                volumes[body] = volumes.get(body, 0) + sign * volume
steps = {"load": 1, "tree": 2, "refine": 30, "optimize": 0, "write": 4}
print(json.dumps({"n_tets": 5000, "wall_s": steps, "cpu_s": steps, "crease_length": 12,
                  "kept_crease_length": 11, "peak_rss_mb": {step: 7 for step in steps},
                  "volumes": volumes}))
"""
TETGEN = """
volume = float(re.search("a([0-9.]+)", sys.argv[1])[1])
assert open(sys.argv[2]).readline() == "OFF\\n"
print("Output seconds:  0.25\\nTotal running seconds:  2.75\\n\\n  Mesh tetrahedra: %d"
      % (6 / volume))
"""
GMSH = """
assert open("hxt.mesh").read().endswith("\\n4\\n1 3 2 1\\n1 2 4 1\\n2 3 4 1\\n3 1 4 1\\nEnd\\n")
size = float(re.search("SizeMax = (.*);", open("hxt.geo").read())[1])
print("Info    : Done meshing 3D (Wall 1.5e+00s, CPU 2s)")
with open(sys.argv[-1], "wb") as file:
    n = round(30 / size**3)
    file.write(b"$Nodes\\n$EndNodes\\n$Elements\\n" + struct.pack("<4Q", 1, n, 1, n))
    file.write(struct.pack("<iiiQ", 3, 1, 4, n) + b"12345678" * 5 * n + b"\\n$EndElements\\n")
"""
HEAD = "#!%s\nimport json, os, re, signal, struct, sys, time\n" % sys.executable


class Driver(unittest.TestCase):
    def setUp(self):
        self.directory = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, self.directory)
        self.work = os.path.join(self.directory, "work")
        self.peers = os.path.join(self.directory, "peers")
        for path in (self.work, self.peers):
            os.mkdir(path)
        self.json = os.path.join(self.directory, "rows.json")

    def peer(self, name, text):
        path = os.path.join(self.peers, name)
        with open(path, "w") as file:
            file.write(HEAD + text)
        os.chmod(path, 0o755)

    def run_driver(self, *arguments, exit_code=0):
        """Returns the rows, and what was printed."""
        command = [sys.executable, DRIVER, "--locvol", LOCVOL, "--work", self.work,
                   "--json", self.json, *arguments]
        done = subprocess.run(command, capture_output=True, text=True, cwd=self.directory)
        self.assertEqual(done.returncode, exit_code, done.stderr)
        self.assertEqual(os.listdir(self.work), [])
        if not os.path.exists(self.json):
            return [], done
        with open(self.json) as file:
            return [json.loads(line) for line in file], done

    def errors(self, rows):
        return {row["mesher"]: row.get("error") for row in rows}

    def test_runs_without_peers(self):
        rows, done = self.run_driver("--sizes", "30%,20%", "--repetitions", "2", "--memory",
                                     "256M", "sphere:500")
        self.assertEqual([row["mesher"] for row in rows], ["locvol"] * 2)
        for row in rows:
            self.assertEqual(row["model"], "sphere:500")
            self.assertEqual(list(row["phases"]), ["read", "cover", "refine", "write"])
            self.assertGreater(min(row["phases"].values()), 0)
            self.assertLess(sum(row["phases"].values()), row["seconds"])
            self.assertEqual(len(row["runs"]), 2)
            self.assertEqual(row["seconds"], max(row["runs"]))
            self.assertGreater(row["cpu_seconds"], 0)
            self.assertGreater(row["peak_bytes"], 2**20)
            self.assertGreater(row["store_bytes"], row["tetrahedra"])
            self.assertTrue(2 < row["tetrahedra_per_size3"] < 20, row)
            self.assertNotIn("ratio", row)
        self.assertGreater(rows[1]["tetrahedra"], rows[0]["tetrahedra"])
        lines = done.stdout.splitlines()
        self.assertIn("locvol", lines[0])
        self.assertIn("medians of 2; --memory 256M", lines[0])
        self.assertEqual(sum(line.startswith("| sphere:500 | ") for line in lines), 2)

    def test_compares_with_peers(self):
        self.peer("cgal_mesh3", CGAL)
        self.peer("tetgen", TETGEN)
        self.peer("gmsh", GMSH)
        rows, _ = self.run_driver("--sizes", "25%", "--repetitions", "1", "--peers", self.peers,
                                  "sphere:500")
        self.assertEqual(self.errors(rows), dict.fromkeys(
            ["locvol", "cgal-parallel", "cgal", "tetgen-fill", "hxt-fill"]))
        mine, cgal, tetgen, hxt = (rows[i] for i in (0, 1, 3, 4))
        self.assertEqual(cgal["seconds"], 37)
        self.assertEqual(cgal["phases"], {"read": 3, "refine": 30, "write": 4})
        self.assertEqual(cgal["peak_bytes"], 7 * 2**20)
        self.assertAlmostEqual(cgal["ratio"], 37 / mine["seconds"])
        self.assertAlmostEqual(cgal["ratio_per_tetrahedron"],
                               cgal["ratio"] * mine["tetrahedra"] / cgal["tetrahedra"])
        self.assertEqual((tetgen["seconds"], hxt["seconds"]), (2.5, 1.5))
        for row in (tetgen, hxt):
            self.assertAlmostEqual(row["tetrahedra"] / mine["tetrahedra"], 1, delta=0.05)

    def test_compares_as_many_threads(self):
        self.peer("cgal_mesh3", CGAL)
        rows, _ = self.run_driver("--sizes", "25%", "--threads", "1,2", "--repetitions", "1",
                                  "--peers", self.peers, "--tools", "cgal-parallel,cgal",
                                  "sphere:500")
        self.assertEqual([(row["mesher"], row["threads"]) for row in rows],
                         [("locvol", 1), ("cgal-parallel", 1), ("cgal", 1),
                          ("locvol", 2), ("cgal-parallel", 2)])
        self.assertEqual(rows[0]["tetrahedra"], rows[3]["tetrahedra"])
        for mine, peer in ((0, 1), (0, 2), (3, 4)):
            self.assertAlmostEqual(rows[peer]["ratio"], 37 / rows[mine]["seconds"])

    def test_says_how_much_of_creases_is_kept(self):
        self.peer("cgal_features", CGAL.replace(
            '"wall_s"', '"crease_length": 12, "kept_crease_length": 11, "wall_s"'))
        cube = os.path.join(self.directory, "cube.off")
        with open(cube, "w") as file:
            file.write("OFF\n8 6 0\n" + "".join("%d %d %d\n" % (i & 1, i >> 1 & 1, i >> 2)
                                                for i in range(8))
                       + "4 0 2 3 1\n4 4 5 7 6\n4 0 1 5 4\n4 2 6 7 3\n4 0 4 6 2\n4 1 3 7 5\n")
        rows, done = self.run_driver("--sizes", "25%", "--threads", "1,2", "--repetitions", "1",
                                     "--peers", self.peers, "--tools",
                                     "cgal-features-parallel,cgal-features", cube)
        self.assertEqual([(row["mesher"], row["threads"]) for row in rows],
                         [("locvol", 1), ("cgal-features-parallel", 1), ("cgal-features", 1),
                          ("locvol", 2), ("cgal-features-parallel", 2)])
        self.assertNotIn("error", rows[1])
        self.assertAlmostEqual(rows[0]["crease_length"], 12)
        self.assertAlmostEqual(rows[0]["kept_crease_length"], 12)
        self.assertEqual(rows[1]["kept_crease_length"], 11)
        self.assertEqual([line.split(" | ")[-3] for line in done.stdout.splitlines()
                          if line.startswith("| cube | ")],
                         ["100%", "91.666%", "91.666%", "100%", "91.666%"])

    def test_compares_bodies(self):
        self.peer("cgal_features", CGAL_OF_BODIES)
        rows, done = self.run_driver("--bodies", "--sizes", "25%", "--repetitions", "1", "--peers",
                                     self.peers, "polycrystal:4")
        self.assertEqual(self.errors(rows), dict.fromkeys(
            ["locvol", "cgal-features-parallel", "cgal-features"]))
        self.assertLess(rows[0]["volume_error"], 0.01)
        for row in rows[1:]:
            self.assertLess(row["volume_error"], 1e-9)
        self.assertAlmostEqual(rows[0]["kept_crease_length"], rows[0]["crease_length"])
        self.assertGreater(rows[0]["crease_length"], 24 + 3)  # of the cube, and between the grains
        self.assertIn("| volumes off by |", done.stdout)

    def test_bodies_that_cannot_be_cut_into_patches_have_rows(self):
        self.peer("cgal_features", CGAL_OF_BODIES)
        rows, _ = self.run_driver("--bodies", "--sizes", "25%", "--repetitions", "1", "--peers",
                                  self.peers, "--tools", "cgal-features", "sphere:500")
        self.assertIsNone(rows[0].get("error"))
        self.assertIn("no surface of bodies", rows[1]["error"])

    def test_missing_peers_have_rows(self):
        rows, done = self.run_driver("--sizes", "30%", "--repetitions", "1", "--peers",
                                     self.peers, "--tools", "cgal,hxt-fill", "sphere:500")
        errors = self.errors(rows)
        self.assertIsNone(errors["locvol"])
        self.assertEqual(errors["cgal"], "cgal is not there")
        self.assertIn(errors["hxt-fill"], ("hxt-fill is not there",  # is Gmsh installed?
                                           "no boundary to fill: cgal-parallel is not there"))
        self.assertIn("| cgal is not there |", done.stdout)

    def test_failing_peers_have_rows(self):
        for text, error in (
                ("print('no', file=sys.stderr); sys.exit(3)", "exit code 3: no"),
                ("os.kill(os.getpid(), signal.SIGSEGV)", "signal 11"),
                ("print('done')", "its report cannot be read: 'done\\n'"),
                ("print('{}')", "its report has no 'wall_s'")):
            self.peer("cgal_mesh3", text)
            self.peer("tetgen", "")
            rows, done = self.run_driver("--sizes", "30%", "--repetitions", "1", "--peers",
                                         self.peers, "--tools", "cgal-parallel,tetgen-fill",
                                         "sphere:500")
            self.assertEqual(self.errors(rows[-3:]), {
                "locvol": None, "cgal-parallel": error,
                "tetgen-fill": "no boundary to fill: cgal: " + error})
            self.assertIn("| %s |" % error, done.stdout)

    def test_finds_the_size_for_a_number_of_tetrahedra(self):
        self.peer("cgal_mesh3", CGAL)
        rows, _ = self.run_driver("--cells", "5k,10k", "--repetitions", "1", "--peers",
                                  self.peers, "--tools", "cgal-parallel", "sphere:500")
        counts = [row["tetrahedra"] for row in rows if row["mesher"] == "cgal-parallel"]
        self.assertEqual(len(counts), 2)
        for count, target in zip(counts, (5000, 10000)):
            self.assertAlmostEqual(count / target, 1, delta=0.01)

    def test_scales(self):
        rows, done = self.run_driver("--scaling", "--cells", "10k,3k,1000000G", "--repetitions",
                                     "1", "sphere:500")
        self.assertEqual([row["target"] for row in rows], [3000, 10000, 10**15])
        for row in rows[:2]:
            self.assertAlmostEqual(row["tetrahedra"] / row["target"], 1, delta=0.3)
        self.assertRegex(rows[2]["error"], r"^skipped: needs about \S+ GB of disk, \S+ GB are free")
        self.assertIn("| about 1e+06G |", done.stdout)
        self.assertRegex(done.stdout, r"\n\| sphere:500 \| [0-9.]+k \| [0-9.]+k \| -?[0-9.]+ \| ")

    def test_failing_locvol_has_a_row_and_an_exit_code(self):
        rows, done = self.run_driver("--sizes", "30%", "--memory", "1M", "--repetitions", "1",
                                     "sphere:500", "no-such-file.stl", exit_code=1)
        self.assertIn("exit code 1: locvol: error:", rows[0]["error"])
        self.assertEqual(len(rows), 1)
        self.assertIn("no-such-file.stl", done.stderr)

    def test_wrong_usage_is_refused(self):
        for arguments in ([], ["s.stl"], ["--sizes", "1%"], ["--cells", "x", "s.stl"],
                          ["--scaling", "--sizes", "1%", "s.stl"],
                          ["--sizes", "1%", "--tools", "hammer", "s.stl"],
                          ["--sizes", "1%", "--bodies", "--tools", "cgal", "s.stl"],
                          ["--sizes", "1%", "--repetitions", "0", "s.stl"],
                          ["--sizes", "1%", "--locvol", "/no/such/program", "s.stl"]):
            _, done = self.run_driver(*arguments, exit_code=2)
            self.assertIn("usage: ", done.stderr)
            self.assertNotIn("Traceback", done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
