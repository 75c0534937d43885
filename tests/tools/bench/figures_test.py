"""The pure parts of the benchmarks' driver. Run by ctest, with its folder in PYTHONPATH."""
import os
import resource
import struct
import sys
import tempfile
import unittest

import figures
import meshers
from meshers import Failed


class Counts(unittest.TestCase):
    def test_are_read_and_shown_with_units(self):
        for text, count in (("1", 1), ("50k", 50000), ("1.5M", 1500000), ("2G", 2 * 10**9),
                            ("1e9", 10**9)):
            self.assertEqual(figures.parse_count(text), count)
        for text in ("", "M", "-5k", "0", "0.1", "many", "nan", "inf"):
            with self.assertRaises(ValueError, msg=text):
                figures.parse_count(text)
        for count, text in ((7, "7"), (999, "999"), (1000, "1k"), (123456, "123k"),
                            (999600, "1M"), (20000000, "20M"), (1.04e9, "1.04G")):
            self.assertEqual(figures.count_text(count), text)


class Sizes(unittest.TestCase):
    def test_are_lengths_or_percentages(self):
        self.assertEqual(figures.parse_size("0.25", 8), 0.25)
        self.assertAlmostEqual(figures.parse_size("2%", 8), 0.16)
        for text in ("0", "-1%", "inf", "nan", "%", "small"):
            with self.assertRaises(ValueError, msg=text):
                figures.parse_size(text, 8)

    def test_are_found_for_a_law_of_volume_and_area(self):
        def count(size):
            return 19 / size**3 + 30 / size**2

        model = figures.CountModel([(s, count(s)) for s in (0.2, 0.1)])
        for target in (1e3, 1e6, 2e7, 1e9):
            self.assertAlmostEqual(count(model.size(target)) / target, 1, 6)

    def test_are_found_where_the_surface_takes_away(self):
        def count(size):
            return 19 / size**3 - 4 / size**2

        model = figures.CountModel([(s, count(s)) for s in (0.5, 0.3)])
        for target in (count(0.9), 1e5, 1e9):
            self.assertAlmostEqual(count(model.size(target)) / target, 1, 6)

    def test_are_found_from_one_sample_and_from_contradicting_ones(self):
        one = figures.CountModel([(0.1, 5000)])
        self.assertAlmostEqual(one.size(40000), 0.05)
        # Fewer tetrahedra at a smaller size: the last sample decides.
        two = figures.CountModel([(0.2, 6000), (0.1, 5000)])
        self.assertAlmostEqual(two.size(40000), 0.05)
        same = figures.CountModel([(0.1, 4000), (0.1, 5000)])
        self.assertAlmostEqual(same.size(40000), 0.05)


class Exponents(unittest.TestCase):
    def test_are_those_of_power_laws(self):
        for k in (0, 0.5, 1, 1.25):
            n = (1e6, 1.7e7)
            found = figures.exponent(n[0], 3 * n[0] ** k, n[1], 3 * n[1] ** k)
            self.assertAlmostEqual(found, k)

    def test_are_none_where_there_is_no_growth_or_figure(self):
        self.assertIsNone(figures.exponent(5, 1, 5, 2))
        self.assertIsNone(figures.exponent(5, 0, 6, 2))
        self.assertIsNone(figures.exponent(5, 1, 6, None))


def row(mesher, seconds, tetrahedra, **more):
    return {"model": "ball", "size": 0.5, "size_percent": 25.0, "mesher": mesher, "threads": 1,
            "tetrahedra": tetrahedra, "seconds": seconds, "phases": {"refine": seconds},
            "peak_bytes": 3 * 2**20, "tetrahedra_per_size3": 2.345} | more


class Tables(unittest.TestCase):
    def test_have_the_median_run_with_its_phases(self):
        runs = [{"seconds": s, "phases": {"read": -s}} for s in (5, 1, 3)]
        self.assertEqual(figures.median_run(runs), {"seconds": 3, "phases": {"read": -3}})
        self.assertEqual(figures.median_run(runs[:2])["seconds"], 5)

    def test_compare_as_many_threads_at_the_same_size_alone(self):
        rows = [row("locvol", 2.0, 1000), row("cgal", 8.0, 2000),
                row("cgal", 8.0, 2000, threads=2), row("cgal", 8.0, 2000, size=0.25),
                row("cgal", 8.0, 2000, error="lost")]
        figures.add_ratios(rows)
        self.assertEqual(rows[1]["ratio"], 4)
        self.assertEqual(rows[1]["ratio_per_tetrahedron"], 2)
        for other in (rows[0], *rows[2:]):
            self.assertNotIn("ratio", other)

    def test_need_no_run_of_locvol(self):
        rows = [row("locvol", 0, 0, error="lost"), row("cgal", 8.0, 2000)]
        figures.add_ratios(rows)
        self.assertNotIn("ratio", rows[1])

    def test_are_markdown(self):
        rows = [row("locvol", 2.5, 1000000, store_bytes=12500000, crease_length=24,
                    kept_crease_length=24 * (1 - 1e-12), volume_error=0.00012,
                    phases={"read": 0.25, "cover": 0.5, "refine": 1.5, "write": 0.25}),
                row("cgal", 10, 1500000, crease_length=24, kept_crease_length=24 * (1 - 1e-6)),
                {"model": "ball", "size": 0.5, "size_percent": 25.0, "mesher": "hxt-fill",
                 "threads": 1, "error": "exit code 1: a | b\nc"}]
        figures.add_ratios(rows)
        self.assertEqual(figures.table(rows).splitlines(), [
            "| model | λ | mesher | threads | tetrahedra | total s | read s | cover s | refine s "
            "| write s | tetrahedra/s | peak MiB | store B/tet | tets per λ³ | locvol faster by "
            "| per tet by | creases kept | volumes off by | note |",
            "|" + "---|" * 19,
            "| ball | 25% | locvol | 1 | 1,000,000 | 2.50 | 0.25 | 0.50 | 1.50 | 0.25 | 400,000 "
            "| 3 | 12.5 | 2.35 | — | — | 100% | 0.0001 |  |",
            "| ball | 25% | cgal | 1 | 1,500,000 | 10.0 | — | — | 10.0 | — | 150,000 | 3 | — "
            "| 2.35 | 4.00× | 2.67× | 99.999% | — |  |",
            "| ball | 25% | hxt-fill | 1 |" + " — |" * 14 + " exit code 1: a / b c |"])

    def test_say_how_much_of_creases_is_kept(self):
        for length, kept, text in ((2, 2, "100%"), (3, 3 * (1 - 1e-10), "100%"),
                                   (2, 1.99, "99.500%"), (2, 2.1, "100%"), (2, 0, "0.000%"),
                                   (None, None, "—"), (0, 0, "—"), (2, None, "—")):
            self.assertEqual(figures.kept_text({"crease_length": length,
                                                "kept_crease_length": kept}), text)

    def test_say_how_far_volumes_are_off(self):
        true = {"region 1": 2, "region 2": 8}
        for volumes, error in (({"region 1": 2, "region 2": 8}, 0), ({"region 2": 8}, 1),
                               ({"region 1": 2.5, "region 2": 7.5}, 0.25)):
            self.assertEqual(figures.volume_error(volumes, true), error)

    def test_of_scaling_have_exponents_between_neighbors(self):
        rows = [row("locvol", 1.0, 10**6), row("locvol", 10.0, 10**7, peak_bytes=6 * 2**20),
                {"model": "ball", "size_percent": 1, "mesher": "locvol", "threads": 1,
                 "target": 10**9, "error": "skipped: needs much"},
                row("locvol", 1.0, 10**6, model="cube")]
        lines = figures.scaling_table(rows).splitlines()
        self.assertEqual(len(lines), 6)
        self.assertEqual(lines[4], "| ball | 1% | locvol | 1 | about 1G |" + " — |" * 9
                         + " skipped: needs much |")
        self.assertEqual(figures.exponent_table(rows).splitlines()[2:], [
            "| ball | 1M | 10M | 1.00 | — | — | 1.00 | — | 0.30 |"])


class Files(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.path = os.path.join(directory.name, "file")
        self.other = os.path.join(directory.name, "other")

    def test_off_becomes_medit_with_all_digits(self):
        with open(self.path, "w") as file:
            file.write("OFF\n# a comment\n3 1 0\n0.10000000000000001 0 0\n1 0 0\n0 1e-300 0\n\n"
                       "3 0 1 2\n")
        meshers.off_to_medit(self.path, self.other)
        with open(self.other) as file:
            self.assertEqual(file.read(), "MeshVersionFormatted 2\nDimension 3\nVertices\n3\n"
                             "0.10000000000000001 0 0 0\n1 0 0 0\n0 1e-300 0 0\n"
                             "Triangles\n1\n1 2 3 1\nEnd\n")

    def test_off_that_is_none_fails(self):
        for text in ("", "ply\n", "OFF\n3 1 0\n0 0 0\n", "OFF\nmany\n"):
            with open(self.path, "w") as file:
                file.write(text)
            with self.assertRaises(Failed, msg=text):
                meshers.off_to_medit(self.path, self.other)

    def write_msh(self, blocks):
        with open(self.path, "wb") as file:
            file.write(b"$MeshFormat\n4.1 1 8\n\x01\0\0\0\n$EndMeshFormat\n$Elements\n")
            file.write(struct.pack("<4Q", len(blocks), sum(n for _, _, n in blocks), 1, 99))
            for kind, num_nodes, num in blocks:
                file.write(struct.pack("<iiiQ", 3, 1, kind, num))
                file.write(struct.pack("<%dQ" % (num * (1 + num_nodes)),
                                       *range(num * (1 + num_nodes))))
            file.write(b"\n$EndElements\n")

    def test_tetrahedra_of_a_msh_file_are_counted_alone(self):
        self.write_msh([(15, 1, 2), (1, 2, 5), (2, 3, 7), (4, 4, 11), (4, 4, 3)])
        self.assertEqual(meshers.count_tetrahedra(self.path), 14)
        self.write_msh([])
        self.assertEqual(meshers.count_tetrahedra(self.path), 0)

    def test_large_msh_takes_no_memory(self):
        self.write_msh([(4, 4, 1)])
        with open(self.path, "rb") as file:
            head = file.read().split(b"$Elements")[0]
        num_blocks, num, num_bytes = 3, 10**6, 40 * 10**6
        with open(self.path, "wb") as file:  # the nodes, zeros, take no disk
            file.write(head + b"$Nodes\n")
            file.seek(10**8, os.SEEK_CUR)
            file.write(b"\n$EndNodes\n$Elements\n" + struct.pack("<4Q", num_blocks, 0, 0, 0))
            for _ in range(num_blocks):
                file.write(struct.pack("<iiiQ", 3, 1, 4, num))
                file.seek(num_bytes, os.SEEK_CUR)
            file.write(b"\n$EndElements\n")
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        self.assertEqual(meshers.count_tetrahedra(self.path), num_blocks * num)
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        self.assertLess(grown * 1024, 10 * 2**20)

    def test_mark_across_pieces_is_found(self):
        mark = b"\n$Elements\n"
        for start in range(2**20 - len(mark) - 1, 2**20 + 2):
            with open(self.path, "wb") as file:
                file.seek(start)
                file.write(mark + b"rest")
            with open(self.path, "rb") as file:
                meshers.skip_past(file, mark)
                self.assertEqual(file.read(), b"rest", start)

    def test_msh_that_is_none_fails(self):
        self.write_msh([(4, 4, 11)])
        with open(self.path, "rb") as file:
            whole = file.read()
        for content in (b"", b"$Elements", whole[:-100], whole.replace(b"\4\0\0\0", b"\5\0\0\0")):
            with open(self.path, "wb") as file:
                file.write(content)
            with self.assertRaises(Failed, msg=content[:20]):
                meshers.count_tetrahedra(self.path)

    def test_reports_with_numbers_that_are_none_are_read(self):
        self.assertEqual(meshers.parsed('Warning\n{"a": inf, "b": -nan, "c": "inf", "d": -1.5}'),
                         {"a": None, "b": None, "c": "inf", "d": -1.5})
        for text in ("", "done", "{", '{"a": }'):
            with self.assertRaises(Failed, msg=text):
                meshers.parsed(text)


class Children(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.directory = directory.name

    def run_python(self, text, timeout=600, good_codes=(0,)):
        return meshers.Child([sys.executable, "-c", text], self.directory, timeout, good_codes)

    def assert_fails(self, text, message, timeout=600):
        with self.assertRaises(Failed) as failure:
            self.run_python(text, timeout)
        self.assertEqual(str(failure.exception), message)

    def test_tell_output_time_and_memory(self):
        child = self.run_python("import time; print('done'); time.sleep(0.2)")
        self.assertEqual(child.out, "done\n")
        self.assertGreater(child.seconds, 0.2)
        large = self.run_python("x = b'x' * 100000000; print(len(x))")
        self.assertGreater(large.peak_bytes, child.peak_bytes + 80000000)

    def test_that_fail_say_why(self):
        self.assert_fails("import sys; sys.exit('no\\nway \\n')", "exit code 1: way")
        self.assert_fails("print('no'); import sys; sys.exit(3)", "exit code 3: no")
        # As Gmsh ends: a summary follows the reason.
        self.assert_fails("print('Info    : Go\\nError   : why\\nError   : -----\\nError   : Error summary"
                          "\\nError   : -----'); import sys; sys.exit(1)", "exit code 1: Error   : why")
        self.assert_fails("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "signal 11")
        self.assertEqual(self.run_python("print(1); exit(3)", good_codes=(0, 3)).out, "1\n")
        with self.assertRaisesRegex(Failed, "cannot be run: No such file"):
            meshers.Child(["/no/such/program"], self.directory, 1)

    def test_that_take_too_long_are_killed(self):
        self.assert_fails("import time; time.sleep(600)", "took more than 0.5 s", timeout=0.5)


class Disk(unittest.TestCase):
    def test_bytes_are_those_taken(self):
        with tempfile.TemporaryDirectory() as directory:
            self.assertEqual(meshers.disk_bytes(directory), 0)
            with open(os.path.join(directory, "data"), "wb") as file:
                file.write(b"x" * 100000)
                file.flush()
                os.fsync(file.fileno())
            taken = meshers.disk_bytes(directory)
            self.assertGreaterEqual(taken, 100000)
            self.assertLess(taken, 200000)


if __name__ == "__main__":
    unittest.main()
