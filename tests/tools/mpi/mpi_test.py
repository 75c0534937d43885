"""Runs of several processes against one: the same bytes, also after processes were killed.

Usage: mpi_test.py LOCVOL LOCVOL_MPI MPIRUN
"""

import array
import json
import os
import pathlib
import random
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest

LOCVOL, LOCVOL_MPI, MPIRUN = sys.argv[1:4]
ENVIRONMENT = dict(os.environ, OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1",
                   OMPI_MCA_rmaps_base_oversubscribe="1")


def processes_of(parent):
    """The ids of all processes below one."""
    found = []
    for stat in pathlib.Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rsplit(")", 1)[1].split()
        except OSError:  # it has ended
            continue
        if int(fields[1]) == parent:
            child = int(stat.parent.name)
            found += [child] + processes_of(child)
    return found


def name_of(process):
    try:
        return pathlib.Path(f"/proc/{process}/comm").read_text().strip()
    except OSError:
        return ""


def ranks_of(run):
    return [p for p in processes_of(run.pid) if name_of(p) == "locvol-mpi"]


def catches(process, wanted):
    """Is it a rank that has a handler of its own for the signal?"""
    try:
        status = pathlib.Path(f"/proc/{process}/status").read_text()
    except OSError:
        return False
    caught = re.search(r"SigCgt:\s*([0-9a-f]+)", status)
    return (name_of(process) == "locvol-mpi" and caught is not None
            and int(caught[1], 16) >> (wanted - 1) & 1 == 1)


def arrays_of(file):
    """The arrays of a raw VTU file, by name."""
    head, data = file.read_bytes().split(b'encoding="raw">', 1)
    data = data[data.index(b"_") + 1:]
    arrays = {}
    for kind, name, offset in re.findall(
            rb'<DataArray type="(\w+)" Name="(\w+)".*?offset="(\d+)"', head):
        code = {b"Float64": "d", b"Int64": "q", b"Int32": "i", b"UInt32": "I", b"UInt8": "B",
                b"Float32": "f"}[kind]
        size, = struct.unpack_from("<Q", data, int(offset))
        start = int(offset) + 8
        arrays[name.decode()] = array.array(code, data[start:start + size])
    return arrays


class MpiTest(unittest.TestCase):
    def setUp(self):
        self.scratch = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.scratch, ignore_errors=True)
        self.surface = self.scratch / "torus.stl"
        subprocess.run([LOCVOL, "generate", "torus", "-n", "5000", "-o", self.surface],
                       check=True, stdout=subprocess.DEVNULL)

    def mesh(self, size, *arguments, name="one.vtu"):
        """The bytes of what one process makes."""
        output = self.scratch / name
        subprocess.run([LOCVOL, "mesh", self.surface, "-o", output, "-s", size, "-q",
                        "--leaf-capacity", "1000", *arguments], check=True,
                       stdout=subprocess.DEVNULL)
        return output.read_bytes()

    def start_command(self, num_ranks, *arguments):
        return subprocess.Popen([MPIRUN, "-n", str(num_ranks), LOCVOL_MPI, *arguments],
                                env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                text=True)

    def start(self, num_ranks, size, *arguments):
        return self.start_command(
            num_ranks, "mesh", self.surface, "-o", self.scratch / "many.vtu", "-s", size, "-q",
            "--leaf-capacity", "1000", *arguments)

    def run_command(self, num_ranks, *arguments):
        """What it said; it has to succeed."""
        run = self.start_command(num_ranks, *arguments)
        said = run.communicate()[0]
        self.assertEqual(run.returncode, 0, said)
        return said

    def ended(self, run):
        """What it said. mpirun may wait for ever for a rank that was killed while it began."""
        try:
            return run.communicate(timeout=20)[0]
        except subprocess.TimeoutExpired:
            for process in [run.pid] + processes_of(run.pid):
                os.kill(process, signal.SIGKILL)
            return run.communicate()[0]

    def test_same_bytes(self):
        expected = self.mesh("6%")
        for num_ranks, num_threads in ((1, 2), (3, 1), (5, 2)):
            run = self.start(num_ranks, "6%", "-t", str(num_threads))
            said = run.communicate()[0]
            self.assertEqual(run.returncode, 0, said)
            self.assertTrue((self.scratch / "many.vtu").read_bytes() == expected, said)
            left = sorted(path.name for path in self.scratch.iterdir())
            self.assertEqual(left, ["many.vtu", "one.vtu", "torus.stl"])

    def test_says_what_one_process_says(self):
        def lists_of(said):
            lines = said.replace("locvol-mpi", "locvol").splitlines()
            return [line for line in lines if "dihedral angle below" in line or line[:2] == "  "]

        options = ("-s", "8%", "--min-dihedral", "40", "--leaf-capacity", "1000")
        alone = subprocess.run([LOCVOL, "mesh", self.surface, "-o", self.scratch / "one.vtu",
                                *options], check=True, stderr=subprocess.PIPE, text=True,
                               stdout=subprocess.DEVNULL)
        # What mpirun hands on of two streams into one may come between two parts of a line.
        said = subprocess.run([MPIRUN, "-n", "3", LOCVOL_MPI, "mesh", self.surface, "-o",
                               self.scratch / "many.vtu", *options], check=True, env=ENVIRONMENT,
                              stderr=subprocess.PIPE, text=True, stdout=subprocess.DEVNULL).stderr
        expected = lists_of(alone.stderr)
        self.assertIn("which nothing improved", expected[0])
        self.assertIn("lists all", expected[-1])
        self.assertEqual([line for line in lists_of(said) if line in expected], expected, said)

    def test_says_once_what_all_find_out(self):
        run = self.start(3, "0.01%")
        said = run.communicate()[0]
        self.assertEqual(run.returncode, 1, said)
        self.assertEqual(said.count("would take about"), 2, said)  # the store, and the mesh

    def test_asks_for_a_directory_that_all_see(self):
        for name in ("here", "there"):
            (self.scratch / name).mkdir()
        mesh = [os.path.abspath(LOCVOL_MPI), "mesh", self.surface, "-o", "many.vtkhdf", "-s", "6%",
                "-q", "--store", self.scratch / "part-%r"]
        run = subprocess.run([MPIRUN, "-n", "1", "-wdir", self.scratch / "here", *mesh, ":",
                              "-n", "2", "-wdir", self.scratch / "there", *mesh],
                             env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                             text=True)
        self.assertEqual(run.returncode, 1, run.stdout)
        self.assertEqual(run.stdout.count("choose a directory that all see"), 1, run.stdout)
        for name in ("here", "there"):
            self.assertEqual(os.listdir(self.scratch / name), [])

    def test_same_bytes_where_sizes_vary(self):
        sizes = ("--growth", "0.2", "--deviation", "0.5%")
        expected = self.mesh("10%", *sizes)
        run = self.start(3, "10%", *sizes)
        said = run.communicate()[0]
        self.assertEqual(run.returncode, 0, said)
        self.assertTrue((self.scratch / "many.vtu").read_bytes() == expected, said)

    def test_goes_on_by_other_numbers_of_ranks(self):
        expected = self.mesh("3%")
        stores = str(self.scratch / "part-%r")
        num_stopped = 0
        for num_ranks in (3, 2, 4):
            run = self.start(num_ranks, "3%", "--store", stores, "-t", "1")
            # Once there is a run, and a rank that would stop.
            while run.poll() is None:
                ranks = [p for p in processes_of(run.pid) if catches(p, signal.SIGUSR1)]
                if ranks and (self.scratch / "part-0").exists():
                    time.sleep(0.3)
                    try:
                        os.kill(ranks[0], signal.SIGUSR1)
                    except ProcessLookupError:
                        pass
                    break
                time.sleep(0.02)
            said = run.communicate()[0]
            self.assertIn(run.returncode, (0, 4), said)
            num_stopped += run.returncode == 4
        self.assertGreater(num_stopped, 0)
        said = self.run_command(4, "resume", stores, "-o", self.scratch / "many.vtu")
        self.assertTrue((self.scratch / "many.vtu").read_bytes() == expected, said)

        # Looked into by one process.
        whole = self.scratch / "whole"
        self.run_command(2, "join", stores, whole)
        alone = subprocess.run([LOCVOL, "audit", whole, "-q", "--json"], check=True,
                               stdout=subprocess.PIPE)
        expected_audit = json.loads(alone.stdout)
        found = json.loads(self.run_command(4, "audit", stores, "-q", "--json"))
        self.assertAlmostEqual(found["mesh"].pop("volume"), expected_audit["mesh"].pop("volume"))
        self.assertEqual(found, expected_audit)
        run = self.start_command(3, "audit", stores)
        said = run.communicate()[0]
        self.assertEqual(run.returncode, 1, said)
        self.assertIn("the run is of 4 ranks", said)
        for view in (["--leaves"], ["--leaves", "--sort", "visits", "--limit", "5", "--json"],
                     ["--leaf", "1,0,0"], ["--unresolved"]):
            alone = subprocess.run([LOCVOL, "inspect", whole, *view], check=True, text=True,
                                   stdout=subprocess.PIPE)
            self.assertEqual(self.run_command(4, "inspect", stores, *view), alone.stdout)
        run = self.start_command(3, "inspect", stores)
        said = run.communicate()[0]
        self.assertEqual(run.returncode, 1, said)
        self.assertIn("the run is of 4 ranks", said)
        for end in ("vtkhdf", "inp", "ply", "vtu"):
            one, many = self.scratch / f"other.{end}", self.scratch / f"another.{end}"
            subprocess.run([LOCVOL, "export", whole, "-q", "-o", one], check=True,
                           stdout=subprocess.DEVNULL)
            self.run_command(3, "export", stores, "-q", "-o", many)
            self.assertTrue(one.read_bytes() == many.read_bytes(), end)
        self.assertTrue((self.scratch / "other.vtu").read_bytes() == expected)

    def test_reports_what_one_process_reports(self):
        stores, whole = self.scratch / "part-%r", self.scratch / "whole"
        page = self.scratch / "many.html"
        self.run_command(3, "mesh", self.surface, "-o", self.scratch / "many.vtu", "-s", "4%", "-q",
                         "--leaf-capacity", "1000", "--store", stores)
        self.run_command(2, "join", stores, whole)
        for limit in ([], ["--cells", "10000"]):
            alone = subprocess.run([LOCVOL, "report", whole, "-o", self.scratch / "one.html",
                                    "--json", *limit], check=True, stdout=subprocess.PIPE)
            said = json.loads(self.run_command(3, "report", stores, "-o", page, "--json", *limit))
            self.assertEqual(said, {**json.loads(alone.stdout), "file": str(page)})
            self.assertTrue(page.read_bytes() == (self.scratch / "one.html").read_bytes())
        page.unlink()

        def expect_refused(num_ranks, of, message):
            run = self.start_command(num_ranks, "report", of, "-o", page)
            said = run.communicate()[0]
            self.assertEqual(run.returncode, 1, said)
            self.assertIn(message, said)
            self.assertFalse(page.exists(), said)

        expect_refused(2, stores, "the run is of 3 ranks")
        expect_refused(3, self.scratch / "none-%r", "the stores hold no run")
        (self.scratch / "part-2/data.mdb").write_bytes(b"")
        expect_refused(3, stores, f"rank 2, store {self.scratch}/part-2: there is no part of")

    def test_looks_into_a_run_that_goes_on(self):
        expected = self.mesh("2%")
        stores = self.scratch / "part-%r"
        run = self.start(2, "2%", "--store", stores, "-t", "1")
        num_live = 0
        while run.poll() is None:
            look = self.start_command(2, "inspect", stores, "--json")
            said = look.communicate()[0]
            if look.returncode != 0:  # nothing else than that it has not begun
                self.assertIn("the stores hold no run", said)
                self.assertEqual(num_live, 0, said)
                continue
            ranks = json.loads(said)["ranks"]
            self.assertEqual(ranks["num_ranks"], 2)
            num_live += ranks["num_working"] > 0
            rows = json.loads(self.run_command(2, "inspect", stores, "--leaves", "--json"))
            self.assertEqual(sum(8.0 ** -row["level"] for row in rows), 1)
        said = run.communicate()[0]
        self.assertEqual(run.returncode, 0, said)
        self.assertGreater(num_live, 0)
        self.assertTrue((self.scratch / "many.vtu").read_bytes() == expected, said)

    def test_pieces_are_parts_of_the_one_file(self):
        self.mesh("6%")
        run = self.start(3, "6%", "--pieces")
        said = run.communicate()[0]
        self.assertEqual(run.returncode, 0, said)
        self.assertFalse((self.scratch / "many.vtu").exists())
        whole = arrays_of(self.scratch / "one.vtu")
        index = (self.scratch / "many.pvtu").read_text()
        cells = []
        for rank in range(3):
            self.assertIn(f'<Piece Source="many-{rank}.vtu"/>', index)
            piece = arrays_of(self.scratch / f"many-{rank}.vtu")
            numbers = piece["GlobalPointIds"]
            self.assertEqual(len(numbers), len(set(numbers)))
            for place, number in enumerate(numbers):
                self.assertEqual(piece["Points"][3 * place:3 * place + 3],
                                 whole["Points"][3 * number:3 * number + 3])
            cells += [numbers[place] for place in piece["connectivity"]]
            self.assertEqual(list(piece["offsets"]),
                             list(range(4, len(piece["connectivity"]) + 4, 4)))
            self.assertEqual(set(piece["types"]), {10})
        self.assertEqual(cells, list(whole["connectivity"]))

    def test_pieces_leave_nothing_behind_when_one_fails(self):
        stores = self.scratch / "part-%r"
        self.run_command(3, "mesh", self.surface, "-o", self.scratch / "one.vtu", "-s", "10%", "-q",
                         "--store", stores)
        output = self.scratch / "pieces"
        (output / "many_2.msh").mkdir(parents=True)
        run = self.start_command(3, "export", stores, "-o", output / "many.msh", "--pieces", "-q")
        said = run.communicate()[0]
        self.assertEqual(run.returncode, 1, said)
        self.assertIn(f"cannot write {output}/many_2.msh: Is a directory", said)
        self.assertEqual([path.name for path in output.iterdir()], ["many_2.msh"], said)

    def go_on_after_kills(self, numbers):
        """A run by one of these numbers of ranks after the other, of which some are killed."""
        expected = self.mesh("4%")
        seed = time.time_ns()
        choice = random.Random(seed)
        stores = ("--store", self.scratch / "part-%r", "-t", "1")
        num_killed = 0
        for attempt in range(100):
            run = self.start(numbers[attempt % len(numbers)], "4%", *stores)
            if attempt < 8:
                while run.poll() is None and not ranks_of(run):
                    time.sleep(0.02)
                time.sleep(choice.uniform(0.1, 0.8))
                ranks = ranks_of(run)
                # One rank, all of them, or mpirun.
                dying = choice.choice([ranks[:1], ranks[-1:], ranks, [run.pid]])
                for process in dying:
                    try:
                        os.kill(process, signal.SIGKILL)
                        num_killed += 1
                    except ProcessLookupError:
                        pass
                for process in ranks if dying == [run.pid] else []:
                    while name_of(process) == "locvol-mpi":  # until they notice, and leave the stores
                        time.sleep(0.02)
            said = self.ended(run)
            if run.returncode == 0:
                break
        self.assertEqual(run.returncode, 0, f"seed {seed}: {said}")
        self.assertGreater(num_killed, 0)
        self.assertTrue((self.scratch / "many.vtu").read_bytes() == expected, f"seed {seed}")

    def test_goes_on_after_kills(self):
        self.go_on_after_kills([3])

    def test_goes_on_after_kills_by_other_numbers_of_ranks(self):
        self.go_on_after_kills([3, 2, 4, 1])

    def test_refuses_a_store_that_is_gone(self):
        stores = ("--store", self.scratch / "part-%r")
        run = self.start(2, "10%", *stores)
        said = run.communicate()[0]
        self.assertEqual(run.returncode, 0, said)
        for command in (["resume"], ["audit"], ["export", "-o", self.scratch / "other.vtu"]):
            alone = subprocess.run([LOCVOL, *command, self.scratch / "part-1"], text=True,
                                   stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            self.assertEqual(alone.returncode, 1, alone.stdout)
            self.assertIn("the part of rank 1 of a run by 2 processes", alone.stdout)
        shutil.rmtree(self.scratch / "part-1")
        run = self.start(2, "10%", *stores)
        said = run.communicate()[0]
        self.assertEqual(run.returncode, 1, said)
        self.assertIn(f"rank 1, store {self.scratch}/part-1: there is no part of the run", said)

    def test_says_what_is_wrong(self):
        run = self.start(2, "10%", "--memory", "1K")
        said = run.communicate()[0]
        self.assertEqual(run.returncode, 1, said)
        run = self.start(2, "10%", "--store", self.scratch / "part")
        said = run.communicate()[0]
        self.assertEqual(run.returncode, 1, said)
        self.assertIn("ranks 0 and 1 would have one store", said)
        run = self.start_command(2, "mesh", self.surface, "-o", self.scratch / "many.mesh",
                                 "--pieces")
        said = run.communicate()[0]
        self.assertEqual(run.returncode, 1, said)
        self.assertIn("--pieces cannot be medit: these formats have pieces: "
                      "vtu, vtu-zlib, vtkhdf, msh", said)
        run = self.start(2, "0")
        said = run.communicate()[0]
        self.assertEqual(run.returncode, 2, said)
        self.assertEqual(said.count("locvol-mpi: error:"), 1, said)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
