"""Python's package beside the command: the same bytes, whatever stops a run.

Usage: python_test.py LOCVOL PACKAGE [TEST...]   PACKAGE: the directory that has locvol/
"""
import ast
import filecmp
import gc
import importlib.metadata
import inspect
import json
import logging
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import threading
import time
import types
import unittest
from unittest import mock

import numpy as np

LOCVOL, PACKAGE = sys.argv.pop(1), sys.argv.pop(1)
sys.path.insert(0, str(pathlib.Path(PACKAGE).resolve()))
import locvol  # noqa: E402

# An octahedron: its upper half and its lower half are groups of their own.
OCTAHEDRON = (
    np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float),
    np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5],
              [0, 3, 5]]))  # fmt: skip
HALVES = {"groups": [0] * 4 + [1] * 4, "names": ["upper", "lower"]}
LEAVES = {"leaf_capacity": 200}

# Two boxes that touch in a face.
PAIR = """v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 0 0 1\nv 1 0 1\nv 0 1 1\nv 1 1 1
v 3 0 0\nv 3 1 0\nv 3 0 1\nv 3 1 1
g rotor\nf 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8\nf 2 8 6
g stator\nf 2 4 10 9\nf 6 11 12 8\nf 2 9 11 6\nf 4 8 12 10\nf 9 10 12 11\nf 2 8 4\nf 2 6 8
"""


def command(*arguments):
    return subprocess.run([LOCVOL, *map(str, arguments)], check=True, stdout=subprocess.PIPE).stdout


def six_volumes(points, cells):
    a, b, c, d = (points[cells[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)


def resident_bytes():
    pages = pathlib.Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


class WithDirectory(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.dir = pathlib.Path(scratch.name)

    def assert_same_bytes(self, one, other):
        self.assertTrue(filecmp.cmp(one, other, shallow=False), f"{one} and {other} differ")


class Arrays(WithDirectory):
    @classmethod
    def setUpClass(cls):
        cls.mesh = locvol.mesh(OCTAHEDRON, 0.07, **HALVES, **LEAVES)

    def test_they_are_the_mesh_that_is_written(self):
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

        self.mesh.write(self.dir / "mesh.vtu")
        reader = vtkXMLUnstructuredGridReader()
        reader.SetFileName(str(self.dir / "mesh.vtu"))
        reader.Update()
        grid = reader.GetOutput()
        np.testing.assert_array_equal(self.mesh.points, vtk_to_numpy(grid.GetPoints().GetData()))
        connectivity = vtk_to_numpy(grid.GetCells().GetConnectivityArray())
        np.testing.assert_array_equal(self.mesh.cells.reshape(-1), connectivity)

    def test_shapes_and_types(self):
        mesh, num = self.mesh, self.mesh.summary.num_cells
        self.assertEqual((mesh.points.dtype, mesh.points.shape[1]), (np.float64, 3))
        self.assertEqual((mesh.cells.dtype, mesh.cells.shape), (np.int64, (num, 4)))
        self.assertEqual((mesh.bodies.dtype, mesh.bodies.shape), (np.uint32, (num,)))
        self.assertEqual((mesh.boundary.dtype, mesh.boundary.shape[1]), (np.int64, 3))
        self.assertEqual((mesh.sheets.dtype, len(mesh.sheets)), (np.uint32, len(mesh.boundary)))
        for array in (mesh.points, mesh.cells, mesh.bodies, mesh.boundary, mesh.sheets):
            self.assertFalse(array.flags.writeable)
        self.assertIs(mesh.points, mesh.points)
        volumes = six_volumes(mesh.points, mesh.cells)
        self.assertGreater(volumes.min(), 0)
        self.assertAlmostEqual(volumes.sum() / 6, 4 / 3, places=9)

    def test_the_boundary_is_of_the_cells_behind_it(self):
        mesh = self.mesh
        cells = mesh.cells[mesh.boundary_cells]
        inside = (mesh.boundary[:, :, None] == cells[:, None, :]).any(axis=2)
        self.assertTrue(inside.all())
        a, b, c = (mesh.points[mesh.boundary[:, i]] for i in range(3))
        self.assertAlmostEqual(np.einsum("ij,ij->", a, np.cross(b, c)) / 6, 4 / 3, places=9)

    def test_names_of_groups_are_those_of_sheets(self):
        mesh = self.mesh
        self.assertEqual(len(mesh.sheet_list), 8)
        self.assertEqual({s.group for s in mesh.sheet_list}, {"upper", "lower"})
        for sheet in mesh.sheet_list:
            self.assertEqual(len(mesh.facets_of(sheet.name)), sheet.num_facets)
            self.assertEqual(sheet.form, "plane")
        heights = mesh.points[mesh.boundary[mesh.facets_of("upper")]][:, :, 2]
        self.assertGreaterEqual(heights.min(), 0)
        self.assertAlmostEqual(sum(s.area for s in mesh.sheet_list), 4 * 3**0.5, places=9)
        with self.assertRaisesRegex(KeyError, "no sheet 'left': there are upper_1"):
            mesh.facets_of("left")

    def test_mapped_ones_are_the_same(self):
        opened = locvol.open(self.mesh.store).load(mapped=True)
        for name in ("points", "cells", "boundary", "sheets", "boundary_cells"):
            mapped = getattr(opened, name)
            self.assertIsInstance(mapped, np.memmap)
            np.testing.assert_array_equal(mapped, getattr(self.mesh, name))
        # Their files have no names: nothing is left of them, whatever ends the process.
        self.assertEqual(os.listdir(self.mesh.store.parent), [self.mesh.store.name])

    def test_large_ones_are_mapped_by_themselves(self):
        opened = locvol.open(self.mesh.store, memory="1G")
        caps = {1 << 30: 100_000}
        with mock.patch("locvol._locvol.memory_cap", caps.__getitem__):
            self.assertIsInstance(opened.cells, np.memmap)

    def test_chunks_are_the_mesh(self):
        mesh = self.mesh
        held = list(mesh.chunks(max_bytes=20_000))  # all of them stay
        self.assertGreater(len(held), 10)
        points = np.concatenate([c.points[: c.num_own] for c in held])
        np.testing.assert_array_equal(points, mesh.points)
        cells = np.concatenate([c.point_numbers[c.cells] for c in held])
        np.testing.assert_array_equal(cells, mesh.cells)
        self.assertEqual([c.first_cell for c in held][1], len(held[0].cells))
        for chunk in held:
            np.testing.assert_array_equal(chunk.points, mesh.points[chunk.point_numbers])
            self.assertFalse(chunk.cells.flags.owndata)
        self.assertEqual(len(list(mesh.chunks(max_bytes=1 << 40))), 1)
        array = next(mesh.chunks()).points  # which the chunk and the stream stay for
        gc.collect()
        np.testing.assert_array_equal(array, mesh.points[: len(array)])

    def test_chunks_of_the_boundary_are_the_boundary(self):
        mesh, held = self.mesh, list(self.mesh.boundary_chunks())
        np.testing.assert_array_equal(np.concatenate([c.facets for c in held]), mesh.boundary)
        np.testing.assert_array_equal(np.concatenate([c.sheets for c in held]), mesh.sheets)
        corners = np.concatenate([c.corners for c in held]).reshape(-1, 3, 3)
        np.testing.assert_array_equal(corners, mesh.points[mesh.boundary])

    def test_chunks_of_second_order_have_nodes(self):
        num_points, num_nodes = len(self.mesh.points), 0
        for chunk in self.mesh.chunks(order=2):
            self.assertEqual(chunk.first_node, num_points + num_nodes)
            num_nodes += chunk.num_own_nodes
            ends = chunk.points[chunk.cells[:, [0, 1]]].mean(axis=1)
            middles = chunk.nodes[chunk.cell_nodes[:, 0]]
            self.assertLess(np.abs(ends - middles).max(), 0.05)
        self.assertGreater(num_nodes, num_points)

    def test_several_bodies(self):
        (self.dir / "pair.obj").write_text(PAIR, encoding="ascii")
        mesh = locvol.mesh(self.dir / "pair.obj", "20%", has_bodies=True, body_sizes={"rotor": 0.1})
        self.assertEqual([b.name for b in mesh.body_list], ["rotor", "stator"])
        volumes = six_volumes(mesh.points, mesh.cells) / 6
        self.assertAlmostEqual(volumes[mesh.bodies == 1].sum(), 1, places=9)
        self.assertAlmostEqual(volumes[mesh.bodies == 2].sum(), 2, places=9)
        between = [s for s in mesh.sheet_list if s.bodies == (2, 1)]
        self.assertEqual(len(between), 1)
        self.assertAlmostEqual(between[0].area, 1, places=9)
        for file, split in ("joined.inp", False), ("split.inp", True):
            mesh.write(self.dir / file, split_interfaces=split)
            command("export", mesh.store, "-o", self.dir / f"command-{file}", "--quiet",
                    *(["--split-interfaces"] if split else []))  # fmt: skip
            self.assert_same_bytes(self.dir / file, self.dir / f"command-{file}")
        self.assertGreater((self.dir / "split.inp").stat().st_size,
                           (self.dir / "joined.inp").stat().st_size)  # fmt: skip

    def test_a_surface_alone_has_no_cells(self):
        mesh = locvol.mesh(OCTAHEDRON, 0.2, surface_only=True)
        self.assertEqual(mesh.cells.shape, (0, 4))
        self.assertGreater(len(mesh.boundary), 100)


class Surfaces(WithDirectory):
    def digest(self, surface, **options):
        mesh = locvol.mesh(surface, 0.3, **options)
        return mesh.points.tobytes() + mesh.cells.tobytes()

    def test_each_kind_is_the_same_surface(self):
        vertices, triangles = OCTAHEDRON
        known = self.digest(OCTAHEDRON)
        padded = np.column_stack([np.full(8, 3), triangles]).reshape(-1)
        import meshio
        from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
        from vtkmodules.vtkCommonCore import vtkPoints
        from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

        data, points, polys = vtkPolyData(), vtkPoints(), vtkCellArray()
        points.SetData(numpy_to_vtk(vertices))
        polys.SetData(numpy_to_vtkIdTypeArray(np.arange(0, 25, 3)),
                      numpy_to_vtkIdTypeArray(triangles.reshape(-1)))  # fmt: skip
        data.SetPoints(points)
        data.SetPolys(polys)
        lines = [f"v {x} {y} {z}" for x, y, z in vertices]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles]
        (self.dir / "octahedron.obj").write_text("\n".join(lines), encoding="ascii")
        kinds = {
            "PyVista": types.SimpleNamespace(points=vertices, faces=padded),
            "trimesh": types.SimpleNamespace(vertices=vertices, faces=triangles),
            "meshio": meshio.Mesh(vertices, [("triangle", triangles)]),
            "VTK": data,
            "lists": (vertices.tolist(), triangles.tolist()),
            "a file": self.dir / "octahedron.obj",
            "a name": str(self.dir / "octahedron.obj"),
        }
        for name, surface in kinds.items():
            with self.subTest(name):
                self.assertEqual(self.digest(surface), known)

    def test_what_is_none_is_refused(self):
        vertices, triangles = OCTAHEDRON
        quads = types.SimpleNamespace(points=vertices, faces=np.array([4, 0, 2, 1, 3]))
        for surface, message in [
            ((1,), "give a path, or a pair"),
            (quads, "no triangles; triangulate it"),
            (3.0, "float is none; give a path"),
            (types.SimpleNamespace(points=vertices, cells_dict={"tetra": []}), "no cells of type"),
            (types.SimpleNamespace(points=vertices, cells_dict={"triangle": triangles, "quad": []}),
             "has cells of type 'quad'; triangulate it"),
            ((vertices[:, :2], triangles), r"shape \(n, 3\)"),
            ((vertices, triangles - 1), "-1 to 4: give indices from 0"),
            ((vertices, triangles.astype(float)), "whole numbers"),
            ((vertices, triangles + 1), "names vertex 6"),
            ((vertices, triangles[:0]), "is empty"),
        ]:
            with self.subTest(message), self.assertRaisesRegex(locvol.InputError, message):
                locvol.mesh(surface, 0.3)
        with self.assertRaisesRegex(locvol.InputError, "belong together"):
            locvol.mesh(OCTAHEDRON, 0.3, groups=[0] * 8)
        with self.assertRaisesRegex(locvol.InputError, "only 1 names"):
            locvol.mesh(OCTAHEDRON, 0.3, groups=[0] * 7 + [1], names=["one"])

    def test_info_and_estimate(self):
        info = locvol.info(OCTAHEDRON, **HALVES)
        self.assertEqual((info.num_triangles, info.num_vertices), (8, 6))
        self.assertAlmostEqual(info.volume, 4 / 3)
        self.assertEqual(info.box_min, (-1, -1, -1))
        estimate = locvol.estimate(info, 0.05)
        self.assertEqual(locvol.estimate(OCTAHEDRON, 0.05, **HALVES).num_cells, estimate.num_cells)
        self.assertGreater(locvol.estimate(info).num_cells, 1e5)
        with self.assertRaisesRegex(TypeError, "info depends on no option 'growth'"):
            locvol.info(OCTAHEDRON, growth=0.2)

    def test_a_size_is_chosen_and_told(self):
        with self.assertLogs("locvol", logging.INFO) as logs:
            mesh = locvol.mesh(OCTAHEDRON, surface_only=True)
        self.assertEqual(mesh.summary.size, locvol.info(OCTAHEDRON).default_size)
        self.assertIn("is chosen", logs.output[0])
        self.assertIn("done", logs.output[-1])

    def test_repairs_are_warnings(self):
        vertices, triangles = OCTAHEDRON
        doubled = np.concatenate([triangles, triangles[:1]])
        with self.assertLogs("locvol", logging.WARNING) as logs:
            locvol.mesh((vertices, doubled), 0.3)
        self.assertIn("triangle", logs.output[0])


class Options(WithDirectory):
    def test_each_stands_in_signature_stub_and_text(self):
        given = [row["name"] for row in locvol._options.rows()]
        self.assertGreater(len(given), 20)
        stub = pathlib.Path(locvol.__file__).with_name("__init__.pyi").read_text(encoding="utf-8")
        stubs = {f.name: f for f in ast.parse(stub).body if isinstance(f, ast.FunctionDef)}
        for function in (locvol.mesh, locvol.estimate):
            names = list(inspect.signature(function).parameters)
            self.assertEqual(set(given) - set(names), set())
            arguments = stubs[function.__name__].args
            self.assertEqual([a.arg for a in arguments.args + arguments.kwonlyargs], names)
        for name in given:
            self.assertRegex(locvol.mesh.__doc__, rf"\n        {name}: \w")
        self.assertNotIn("--", locvol.mesh.__doc__)

    def test_the_stub_has_what_classes_and_methods_have(self):
        stub = pathlib.Path(locvol.__file__).with_name("__init__.pyi").read_text(encoding="utf-8")
        classes = {c.name: c for c in ast.parse(stub).body if isinstance(c, ast.ClassDef)}
        public = [name for name in locvol.__all__ if inspect.isclass(getattr(locvol, name))]
        self.assertEqual(set(classes), set(public))
        for name in public:
            if issubclass(getattr(locvol, name), Exception) or name in ("Ball", "Box", "Segment"):
                continue
            known = {n: m for n, m in vars(getattr(locvol, name)).items() if not n.startswith("_")}
            functions = {f.name: f for f in classes[name].body}
            self.assertEqual(set(functions), set(known), name)
            for method, value in known.items():
                self.assertTrue(value.__doc__, f"{name}.{method} has no docstring")
                if inspect.isfunction(value):
                    arguments = functions[method].args
                    self.assertEqual([a.arg for a in arguments.args + arguments.kwonlyargs],
                                     list(inspect.signature(value).parameters))  # fmt: skip

    def test_each_has_a_value_that_it_takes(self):
        """A new option has to come here, too."""
        (self.dir / "edges.txt").write_text("2 1 0 0 0 1 0\n", encoding="ascii")
        values = {
            "size": "10%", "leaf_capacity": 500, "init": "cover", "seed": 3, "min_dihedral": 12,
            "spacing_floor": 0.03, "growth": 0.1, "max_size": 0.5,
            "shapes": [locvol.Ball(0.1, (0, 0, 1), 0.1), locvol.Box(0.1, (0, 0, 0), (0.1, 0.1, 0)),
                       locvol.Segment("5%", (0, 0, 0), (0, 0, 1))],
            "sheet_sizes": {"upper": 0.15}, "body_sizes": {}, "size_image": None, "per_circle": 12,
            "deviation": 0.1, "layers": 2, "min_size": 0.05, "weld": 0, "sharp_angle": 30,
            "sharp": self.dir / "edges.txt", "has_bodies": True, "voids": [], "gap": 0.001,
            "surface_only": False, "inside": "closed", "wrap_alpha": 0, "wrap_offset": 0}  # fmt: skip
        self.assertEqual(list(values), list(locvol._options.names()))
        several = {"has_bodies", "gap", "body_sizes"}
        options = {name: value for name, value in values.items() if name not in several}
        mesh = locvol.mesh(OCTAHEDRON, **options, **HALVES)
        kept = mesh.inspect()["parameters"]
        for name in ("leaf_capacity", "seed", "min_dihedral", "growth", "per_circle", "layers"):
            self.assertEqual(kept[name], values[name])
        self.assertEqual(kept["num_shapes"], 3)

    def test_a_wrong_one_is_refused(self):
        for options, error, message in [
            ({"groth": 1}, TypeError, "no option 'groth'; is 'growth' meant?"),
            ({"growth": 2}, locvol.InputError, "from 0, which"),
            ({"growth": "much"}, TypeError, "growth: give a number, not 'much'"),
            ({"seed": -1}, TypeError, "seed: give a whole number"),
            ({"seed": True}, TypeError, "seed: give a whole number"),
            ({"has_bodies": 1}, TypeError, "has_bodies: give True or False"),
            ({"init": "both"}, locvol.InputError, "init 'both'"),
            ({"voids": "core"}, TypeError, "voids: give a list of names"),
            ({"sheet_sizes": [1]}, TypeError, "sheet_sizes: give a dict"),
            ({"sheet_sizes": {"left": 0.1}}, locvol.InputError, "no sheet of the surface"),
            ({"shapes": [1]}, TypeError, "shapes: give a list of Ball"),
            ({"shapes": [locvol.Ball(0.1, (0, 0))]}, TypeError, "three coordinates"),
            ({"memory": -5}, locvol.InputError, "memory -5: give bytes"),
            ({"memory": "much"}, locvol.InputError, "memory 'much'"),
        ]:
            with self.subTest(options), self.assertRaisesRegex(error, message):
                locvol.mesh(OCTAHEDRON, 0.3, **options)


class Errors(WithDirectory):
    def test_are_classes_with_place_and_cure(self):
        with self.assertRaises(locvol.InputError) as caught:
            locvol.mesh(OCTAHEDRON, 0.3, growth=2)
        self.assertEqual(caught.exception.place, "growth 2")
        self.assertTrue(caught.exception.cure.startswith("give a number from 0"))
        self.assertIsInstance(caught.exception, ValueError)
        with self.assertRaises(locvol.InputError) as caught:
            locvol.mesh((OCTAHEDRON[0], OCTAHEDRON[1][1:]), 0.3)
        self.assertEqual(caught.exception.place, "surface in memory")
        self.assertTrue(caught.exception.cure.startswith("close the holes"))
        with self.assertRaises(locvol.MemoryLimitError) as caught:
            locvol.mesh(OCTAHEDRON, 0.3, memory="1M")
        self.assertRegex(caught.exception.cure, r"give \d+M or more")
        with self.assertRaises(locvol.InputError) as caught:
            locvol.mesh(OCTAHEDRON, 0.3, max_size=0.4)
        self.assertIsNone(caught.exception.place)
        with self.assertRaises(locvol.StoreError) as caught:
            locvol.open(self.dir / "absent")
        self.assertEqual(caught.exception.place, f"store {self.dir / 'absent'}")

    def test_of_stores_and_files(self):
        store = self.dir / "store"
        mesh = locvol.mesh(OCTAHEDRON, 0.3, store=store)
        with self.assertRaisesRegex(locvol.MismatchError, "Add force to begin anew"):
            locvol.mesh(OCTAHEDRON, 0.25, store=store)
        locvol.mesh(OCTAHEDRON, 0.25, store=store, force=True)
        with self.assertRaises(locvol.SystemFailure):
            mesh.write(self.dir / "absent" / "mesh.vtu")
        with self.assertRaisesRegex(locvol.InputError, "names no known format"):
            mesh.write(self.dir / "mesh.foo")
        with self.assertRaisesRegex(locvol.InputError, "no cells of order 2"):
            mesh.write(self.dir / "mesh.stl", order=2)
        with self.assertRaisesRegex(locvol.InputError, "format 'foo'"):
            mesh.write(self.dir / "mesh", "foo")


class Runs(WithDirectory):
    """Runs that take a second or two, on which something comes down."""

    SIZE, OPTIONS = "1.6%", {"growth": 0.2, "leaf_capacity": 3000}
    SCRIPT = """
import sys
sys.path.insert(0, {package!r})
import locvol
try:
    mesh = locvol.mesh({surface!r}, {size!r}, store={store!r}, threads=1, **{options!r})
    mesh.write({file!r})
except locvol.Interrupted as error:
    assert isinstance(error.__cause__, KeyboardInterrupt)
    print("interrupted", error.mesh.is_complete)
    sys.exit(3)
"""

    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.all = pathlib.Path(cls.scratch.name)
        cls.surface = cls.all / "ball.stl"
        command("generate", "sphere", "-o", cls.surface, "--triangles", "2k")
        command("mesh", cls.surface, "-o", cls.all / "ball.vtu", "--size", cls.SIZE, "--growth",
                "0.2", "--leaf-capacity", "3000", "--quiet")  # fmt: skip

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    def mesh(self, **more):
        return locvol.mesh(self.surface, self.SIZE, **self.OPTIONS, **more)

    def assert_it_is_the_commands(self, mesh):
        mesh.write(self.dir / "mesh.vtu")
        self.assert_same_bytes(self.dir / "mesh.vtu", self.all / "ball.vtu")

    def test_progress_can_stop_it_and_it_goes_on_to_the_same_bytes(self):
        stages = []

        def progress(status):
            stages.append(status.stage)
            return status.stage != "refine"

        with self.assertRaises(locvol.Interrupted) as caught:
            self.mesh(progress=progress, threads=1)
        mesh = caught.exception.mesh  # whose store has no name
        self.assertFalse(mesh.is_complete)
        self.assertIn("refine", stages)
        with self.assertRaisesRegex(locvol.StoreError, "unfinished"):
            mesh.write(self.dir / "mesh.vtu")
        with self.assertRaises(locvol.StoreError):
            mesh.points
        self.assertEqual(mesh.inspect()["num_cells"], mesh.summary.num_cells)
        self.assertIs(mesh.resume(), mesh)
        self.assertTrue(mesh.is_complete)
        self.assert_it_is_the_commands(mesh)
        self.assertTrue(mesh.audit()["is_valid"])

    def test_what_progress_raises_comes_out_after_a_commit(self):
        def progress(status):
            if status.stage == "refine":
                raise RuntimeError("enough")

        store = self.dir / "store"
        with self.assertRaisesRegex(RuntimeError, "enough"):
            self.mesh(progress=progress, store=store, threads=1)
        opened = locvol.open(store)
        self.assertFalse(opened.is_complete)
        self.assertGreater(opened.summary.num_visits, 0)
        self.assert_it_is_the_commands(self.mesh(store=store))

    def begin(self, store):
        script = self.SCRIPT.format(
            package=PACKAGE, surface=str(self.surface), size=self.SIZE, store=str(store),
            options=self.OPTIONS, file=str(self.dir / "script.vtu"))  # fmt: skip
        return subprocess.Popen([sys.executable, "-B", "-c", script], stdout=subprocess.PIPE,
                                text=True)  # fmt: skip

    def wait_for_visits(self, process, store):
        until = time.monotonic() + 60
        while time.monotonic() < until and process.poll() is None:
            try:
                if locvol.open(store).summary.num_visits > 0:
                    return
            except locvol.StoreError:  # there is none yet
                pass
            time.sleep(0.01)
        self.fail("it was over before it could be stopped")

    def test_an_interrupt_stops_it_soon_and_it_goes_on_to_the_same_bytes(self):
        store = self.dir / "store"
        with self.begin(store) as process:
            self.wait_for_visits(process, store)
            sent = time.monotonic()
            process.send_signal(signal.SIGINT)
            output, _ = process.communicate(timeout=60)
            self.assertLess(time.monotonic() - sent, 2)
        self.assertEqual((process.returncode, output), (3, "interrupted False\n"))
        with self.begin(store) as process:
            self.assertEqual(process.wait(timeout=60), 0)
        self.assert_same_bytes(self.dir / "script.vtu", self.all / "ball.vtu")

    def test_a_kill_loses_nothing_that_was_committed(self):
        store = self.dir / "store"
        with self.begin(store) as process:
            self.wait_for_visits(process, store)
            process.kill()
        self.assertGreater(locvol.open(store).summary.num_visits, 0)
        with self.begin(store) as process:
            self.assertEqual(process.wait(timeout=60), 0)
        self.assert_same_bytes(self.dir / "script.vtu", self.all / "ball.vtu")
        self.assert_it_is_the_commands(locvol.open(store))

    def test_other_threads_go_on(self):
        num, is_over = 0, threading.Event()

        def count():
            nonlocal num
            while not is_over.is_set():
                num += 1
                time.sleep(0.001)

        thread = threading.Thread(target=count)
        thread.start()
        began, before = time.monotonic(), num
        self.mesh(threads=1)
        seconds, counted = time.monotonic() - began, num - before
        is_over.set()
        thread.join()
        self.assertGreater(counted, 50 * seconds)

    def test_several_threads_may_use_one_mesh(self):
        mesh, found = locvol.mesh(OCTAHEDRON, 0.1, **LEAVES), []
        threads = [threading.Thread(target=lambda: found.append(
            (mesh.statistics().num_cells, sum(len(c.cells) for c in mesh.chunks(5000)))))
            for _ in range(4)]  # fmt: skip
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        num = mesh.summary.num_cells
        self.assertEqual(found, [(num, num)] * 4)

    def test_each_format_has_the_commands_bytes(self):
        store = self.dir / "store"
        locvol.mesh(OCTAHEDRON, 0.1, store=store)
        mesh = locvol.open(store)
        for name, options, more in [
            ("mesh.msh", {}, []), ("mesh.inp", {"order": 2}, ["--order", "2"]),
            ("mesh.stl", {}, []), ("mesh.vtu", {"boundary": True, "quality": True, "faces": True},
                                   ["--boundary", "--cell-data", "quality", "--faces"]),
            ("mesh.txt", {"format": "abaqus"}, ["--format", "abaqus"]),
        ]:  # fmt: skip
            with self.subTest(name):
                num = mesh.write(self.dir / name, **options)
                self.assertEqual(num, (self.dir / name).stat().st_size)
                command("export", store, "-o", self.dir / f"command-{name}", *more, "--quiet")
                self.assert_same_bytes(self.dir / name, self.dir / f"command-{name}")
        self.assert_same_bytes(self.dir / "mesh.vtu.faces.json",
                               self.dir / "command-mesh.vtu.faces.json")  # fmt: skip

    def test_looks_into_it_as_the_command_does(self):
        store = self.dir / "store"
        mesh = locvol.mesh(OCTAHEDRON, 0.1, store=store)
        self.assertEqual(mesh.audit(), json.loads(command("audit", store, "--json", "--quiet")))
        self.assertEqual(mesh.inspect(), json.loads(command("inspect", store, "--json")))
        self.assertEqual(mesh.report(self.dir / "page.html"),
                         (self.dir / "page.html").stat().st_size)  # fmt: skip
        command("report", store, "-o", self.dir / "command.html")
        self.assert_same_bytes(self.dir / "page.html", self.dir / "command.html")
        self.assertEqual(mesh.statistics().num_cells, mesh.summary.num_cells)
        self.assertEqual((mesh.unresolved(), mesh.poor_cells()), ([], []))
        self.assertIn("num_cells=", repr(mesh.summary))

    def test_a_store_without_a_name_goes_with_its_mesh(self):
        mesh = locvol.mesh(OCTAHEDRON, 0.3, scratch=self.dir)
        chunks = mesh.chunks()
        self.assertEqual(len(os.listdir(self.dir)), 1)
        del mesh
        self.assertEqual(len(os.listdir(self.dir)), 1)  # a stream reads it
        self.assertGreater(len(next(chunks).cells), 0)
        del chunks
        gc.collect()
        self.assertEqual(os.listdir(self.dir), [])

    def test_nothing_leaks(self):
        scratch = "/dev/shm" if os.access("/dev/shm", os.W_OK) else self.dir  # no disk to wait for
        def some(num):
            for i in range(num):
                mesh = locvol.mesh(OCTAHEDRON, 0.35, threads=1, **HALVES, scratch=scratch,
                                   progress=lambda status: None)  # fmt: skip
                mesh.load()
                sum(len(c.cells) for c in mesh.chunks())
                if i % 10 == 0:
                    with self.assertRaises(locvol.InputError):
                        locvol.mesh(OCTAHEDRON, 0.35, growth=2)

        some(60)
        before, descriptors = resident_bytes(), len(os.listdir("/proc/self/fd"))
        some(200)
        self.assertLess(resident_bytes() - before, 3 << 20)
        self.assertEqual(len(os.listdir("/proc/self/fd")), descriptors)


class Neighbors(WithDirectory):
    """Other libraries take meshes."""

    @classmethod
    def setUpClass(cls):
        cls.mesh = locvol.mesh(OCTAHEDRON, 0.15, **HALVES)

    def test_vtk(self):
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkFiltersVerdict import vtkMeshQuality

        grid = self.mesh.to_vtk()
        self.assertEqual(grid.GetNumberOfCells(), self.mesh.summary.num_cells)
        np.testing.assert_array_equal(vtk_to_numpy(grid.GetPoints().GetData()), self.mesh.points)
        quality = vtkMeshQuality()
        quality.SetTetQualityMeasureToVolume()
        quality.SetInputData(grid)
        quality.Update()
        volumes = vtk_to_numpy(quality.GetOutput().GetCellData().GetArray("Quality"))
        self.assertAlmostEqual(volumes.sum(), 4 / 3, places=9)
        both = self.mesh.to_vtk(boundary=True)
        num = len(self.mesh.boundary)
        self.assertEqual(both.GetNumberOfCells(), grid.GetNumberOfCells() + num)
        sheets = vtk_to_numpy(both.GetCellData().GetArray("sheet"))
        np.testing.assert_array_equal(sheets[-num:], self.mesh.sheets)

    def test_the_arrays_stay_as_long_as_vtk_has_them(self):
        mesh = locvol.mesh(OCTAHEDRON, 0.2)
        grid, points = mesh.to_vtk(), mesh.points.copy()
        del mesh
        gc.collect()
        np.full((len(points) * 8, 3), 7.0)  # which would take their place
        self.assertEqual(grid.GetPoint(len(points) - 1), tuple(points[-1]))

    def test_meshio(self):
        import meshio

        made = self.mesh.to_meshio()
        self.assertEqual(list(made.field_data["upper_1"]), [1, 2])
        made.write(self.dir / "mesh.vtu")
        read = meshio.read(self.dir / "mesh.vtu")
        np.testing.assert_array_equal(read.points, self.mesh.points)
        np.testing.assert_array_equal(read.cells_dict["tetra"], self.mesh.cells)
        np.testing.assert_array_equal(read.cells_dict["triangle"], self.mesh.boundary)
        np.testing.assert_array_equal(read.cell_data_dict["sheet"]["triangle"], self.mesh.sheets)

    def test_pyvista(self):
        """On a stand-in, for Debian has none: what PyVista 0.48 has of accessors."""
        stand_in = types.ModuleType("pyvista")
        stand_in.PolyData = type("PolyData", (), {})
        stand_in.wrap = lambda grid: ("wrapped", grid)

        def register_dataset_accessor(name, target):
            def register(accessor):
                setattr(target, name, property(accessor))
                return accessor
            return register

        stand_in.register_dataset_accessor = register_dataset_accessor
        found = importlib.metadata.entry_points(group="pyvista.accessors")
        entry = [e for e in found if e.name == "locvol"][0]
        with mock.patch.dict(sys.modules, {"pyvista": stand_in}):
            entry.load()
            surface = stand_in.PolyData()
            surface.points = OCTAHEDRON[0]
            surface.faces = np.column_stack([np.full(8, 3), OCTAHEDRON[1]]).reshape(-1)
            wrapped, grid = surface.locvol.mesh(0.3)
            self.assertEqual(wrapped, "wrapped")
            run = surface.locvol.run(0.3)
            self.assertEqual(grid.GetNumberOfCells(), run.summary.num_cells)
            self.assertEqual(surface.locvol.info().num_triangles, 8)


if __name__ == "__main__":
    unittest.main()
