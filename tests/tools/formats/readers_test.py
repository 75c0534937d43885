"""Other programs' readers on one mesh in every format: the same points, cells and boundary.

Usage: readers_test.py LOCVOL [LOCVOL_MPI MPIRUN]     exit code 77: a reader is not installed
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

try:
    import gmsh
    import meshio
    import numpy as np
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy
except ImportError as error:
    print(f"skipped: {error}. To run it: tools/test.sh -R tools/readers")
    sys.exit(77)

LOCVOL = sys.argv.pop(1)
LOCVOL_MPI, MPIRUN = (sys.argv.pop(1), sys.argv.pop(1)) if len(sys.argv) > 2 else (None, None)
MPI_ENVIRONMENT = dict(os.environ, OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1",
                       OMPI_MCA_rmaps_base_oversubscribe="1")
# Across from each vertex of a positively oriented cell, counterclockwise from outside.
FACETS = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
ABAQUS_FACES = {"S1": 3, "S2": 2, "S3": 0, "S4": 1}  # the vertex that each lies across from


def run(command, **options):
    result = subprocess.run(command, capture_output=True, text=True, **options)
    assert result.returncode == 0, result.stderr
    return result.stdout


def locvol(*arguments):
    return run([LOCVOL, *arguments])


def canonical(triangles):
    """Each from its smallest vertex on, the way round kept; sorted."""
    triangles = np.asarray(triangles, dtype=np.int64)
    start = np.argmin(triangles, axis=1)[:, None]
    rolled = np.take_along_axis(triangles, (start + np.arange(3)) % 3, axis=1)
    return rolled[np.lexsort(rolled.T[::-1])]


def boundary_of(cells):
    """The facets in one cell, and (cell, vertex across) of each."""
    facets = cells[:, FACETS].reshape(-1, 3)
    _, first, count = np.unique(np.sort(facets, axis=1), axis=0, return_index=True,
                                return_counts=True)
    places = np.sort(first[count == 1])
    return facets[places], np.stack([places // 4, places % 4], axis=1)


def volumes(points, cells):
    a, b, c, d = (points[cells[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6


def ratio_and_angle(points, cells):
    """VTK's circumspheres, and angles at edges between the heights of the other two vertices."""
    corners = points[cells]
    radius = np.empty(len(cells))
    for i, (p0, p1, p2, p3) in enumerate(corners):
        radius[i] = np.sqrt(vtk.vtkTetra.Circumsphere(p0, p1, p2, p3, [0.0] * 3))
    pairs = [(i, j) for i in range(4) for j in range(i)]
    lengths = [np.linalg.norm(corners[:, i] - corners[:, j], axis=1) for i, j in pairs]
    angles = []
    for i, j in pairs:
        axis = corners[:, j] - corners[:, i]
        axis /= np.linalg.norm(axis, axis=1)[:, None]
        heights = []
        for k in set(range(4)) - {i, j}:
            side = corners[:, k] - corners[:, i]
            height = side - np.einsum("ij,ij->i", side, axis)[:, None] * axis
            heights.append(height / np.linalg.norm(height, axis=1)[:, None])
        angles.append(np.degrees(np.arccos(np.einsum("ij,ij->i", *heights))))
    return radius / np.min(lengths, axis=0), np.min(angles, axis=0)


class Mesh:
    """What a reader made of a file."""

    def __init__(self, points, cells, cell_data=None, point_data=None):
        self.points = np.asarray(points, dtype=float)
        self.cells = np.asarray(cells, dtype=np.int64)
        self.cell_data = cell_data or {}
        self.point_data = point_data or {}


def arrays_of(data):
    return {data.GetArrayName(i): vtk_to_numpy(data.GetArray(i))
            for i in range(data.GetNumberOfArrays())}


def read_vtk(reader, file):
    reader.SetFileName(file)
    reader.Update()
    grid = reader.GetOutput()
    types = vtk_to_numpy(grid.GetCellTypesArray())
    assert (types == vtk.VTK_TETRA).all()
    cells = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(-1, 4)
    offsets = vtk_to_numpy(grid.GetCells().GetOffsetsArray())
    assert (offsets == 4 * np.arange(len(cells) + 1)).all()
    return Mesh(vtk_to_numpy(grid.GetPoints().GetData()), cells, arrays_of(grid.GetCellData()),
                arrays_of(grid.GetPointData()))


def read_vtu(file):
    return read_vtk(vtk.vtkXMLUnstructuredGridReader(), file)


def read_pvtu(file):
    return read_vtk(vtk.vtkXMLPUnstructuredGridReader(), file)


def read_vtkhdf(file):
    return read_vtk(vtk.vtkHDFReader(), file)


def read_surface(reader, file):
    """Points and triangles; STL's corners are merged where they are equal."""
    reader.SetFileName(file)
    reader.Update()
    data = reader.GetOutput()
    triangles = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return vtk_to_numpy(data.GetPoints().GetData()).astype(float), triangles


class Readers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.directory = tempfile.TemporaryDirectory()
        surface, mesh = cls.path("three.stl"), cls.path("three.vtu")
        cls.store = cls.path("store")
        locvol("generate", "three-holes", "-o", surface, "-n", "5k")
        # Small leaves, so that cells and facets have their vertices in several.
        locvol("mesh", surface, "-o", mesh, "--size", "8%", "--store", cls.store, "--quiet",
               "--leaf-capacity", "300")
        cls.audit = json.loads(locvol("audit", cls.store, "--json"))["mesh"]
        cls.mesh = read_vtu(mesh)
        cls.facets, cls.places = boundary_of(cls.mesh.cells)

    @classmethod
    def tearDownClass(cls):
        cls.directory.cleanup()

    @classmethod
    def path(cls, name):
        return os.path.join(cls.directory.name, name)

    def export(self, name, *arguments):
        file = self.path(name)
        locvol("export", self.store, "-o", file, *arguments)
        return file

    def expect_same(self, points, cells, tolerance=0):
        self.assertEqual(np.shape(points), self.mesh.points.shape)
        error = np.abs(points - self.mesh.points).max()
        self.assertLessEqual(error, tolerance)
        np.testing.assert_array_equal(cells, self.mesh.cells)

    def expect_boundary(self, triangles):
        np.testing.assert_array_equal(canonical(triangles), canonical(self.facets))

    def test_vtu(self):
        self.assertGreater(len(self.mesh.cells), 5000)
        self.assertGreater(len(set(self.mesh.cell_data["leaf"])), 8)
        self.assertGreater(volumes(self.mesh.points, self.mesh.cells).min(), 0)
        self.assertEqual(len(self.mesh.points), len(np.unique(self.mesh.cells)))
        self.assertEqual(len(self.facets), self.audit["num_boundary_facets"])
        for options in (["--format", "vtu-zlib"], ["--threads", "1"]):
            mesh = read_vtu(self.export("again.vtu", *options))
            self.expect_same(mesh.points, mesh.cells)
            np.testing.assert_array_equal(mesh.cell_data["leaf"], self.mesh.cell_data["leaf"])

    def test_vtkhdf(self):
        mesh = read_vtkhdf(self.export("mesh.vtkhdf"))
        self.expect_same(mesh.points, mesh.cells)
        np.testing.assert_array_equal(mesh.cell_data["leaf"], self.mesh.cell_data["leaf"])

    def test_quality(self):
        ratios, angles = ratio_and_angle(self.mesh.points, self.mesh.cells)
        for file, options, read in (("q.vtu", [], read_vtu), ("q.vtkhdf", [], read_vtkhdf),
                                    ("qz.vtu", ["--format", "vtu-zlib"], read_vtu)):
            data = read(self.export(file, "--cell-data", "quality", *options)).cell_data
            np.testing.assert_allclose(data["radius_edge_ratio"], ratios, rtol=2e-5)
            np.testing.assert_allclose(data["min_dihedral_degrees"], angles, rtol=2e-4)

    def test_gmsh(self):
        for options in ([], ["--format", "msh2"]):
            gmsh.initialize()
            gmsh.option.setNumber("General.Terminal", 0)
            gmsh.open(self.export("mesh.msh", *options))
            tags, coordinates, _ = gmsh.model.mesh.getNodes()
            points = np.empty((len(tags), 3))
            points[tags.astype(np.int64) - 1] = coordinates.reshape(-1, 3)
            cell_tags, cells = gmsh.model.mesh.getElementsByType(4)
            facet_tags, facets = gmsh.model.mesh.getElementsByType(2)
            groups = {gmsh.model.getPhysicalName(*group): group
                      for group in gmsh.model.getPhysicalGroups()}
            in_group = {name: gmsh.model.mesh.getNodesForPhysicalGroup(*group)[0]
                        for name, group in groups.items()}
            gmsh.finalize()
            self.expect_same(points, cells.astype(np.int64).reshape(-1, 4) - 1)
            self.expect_boundary(facets.astype(np.int64).reshape(-1, 3) - 1)
            all_tags = np.concatenate([cell_tags, facet_tags])
            self.assertEqual(len(np.unique(all_tags)), len(all_tags))
            self.assertEqual({name: dimension for name, (dimension, _) in groups.items()
                              if dimension >= 2}, {"volume": 3, "boundary": 2})
            self.assertEqual(len(in_group["volume"]), len(self.mesh.points))
            self.assertEqual(len(in_group["boundary"]), len(np.unique(self.facets)))

    def test_medit(self):
        for name in ("mesh.mesh", "mesh.meshb"):
            mesh = meshio.read(self.export(name))
            self.expect_same(mesh.points, mesh.cells_dict["tetra"])
            self.expect_boundary(mesh.cells_dict["triangle"])

    def test_abaqus(self):
        file = self.export("mesh.inp")
        mesh = meshio.read(file)
        self.expect_same(mesh.points, mesh.cells_dict["tetra"], tolerance=1e-13)
        np.testing.assert_array_equal(np.sort(mesh.point_sets["boundary"]),
                                      np.unique(self.facets))
        with open(file) as text:
            lines = text.read().splitlines()
        start = lines.index("*SURFACE, NAME=boundary, TYPE=ELEMENT") + 1
        pairs = [line.split(", ") for line in lines[start:start + len(self.facets)]]
        found = np.array([(int(element) - 1, ABAQUS_FACES[face]) for element, face in pairs])
        np.testing.assert_array_equal(found, self.places)
        nodes = lines[lines.index("*NODE") + 1:lines.index("*ELEMENT, TYPE=C3D4, ELSET=volume")]
        self.assertLessEqual(max(len(item) for line in nodes for item in line.split(", ")), 20)

    def test_tetgen(self):
        mesh = meshio.read(self.export("mesh.node"))
        self.expect_same(mesh.points, mesh.cells_dict["tetra"])
        os.remove(self.path("mesh.node"))
        os.remove(self.path("mesh.ele"))
        self.export("mesh.ele")
        self.assertTrue(os.path.exists(self.path("mesh.node")))

    def test_boundary_surfaces(self):
        vertices = np.unique(self.facets)
        for name, reader in (("b.ply", vtk.vtkPLYReader()), ("b.obj", vtk.vtkOBJReader())):
            points, triangles = read_surface(reader, self.export(name))
            # VTK keeps float32, and rounds what it reads as text twice.
            np.testing.assert_allclose(
                points, self.mesh.points[vertices].astype(np.float32), rtol=1.2e-7, atol=1e-12)
            self.expect_boundary(vertices[triangles])
            exact = meshio.read(self.path(name))
            np.testing.assert_array_equal(exact.points, self.mesh.points[vertices])
        points, triangles = read_surface(vtk.vtkSTLReader(), self.export("b.stl"))
        place = {tuple(p): v for v, p in
                 zip(vertices, self.mesh.points[vertices].astype(np.float32).astype(float))}
        self.expect_boundary([[place[tuple(points[v])] for v in t] for t in triangles])

    # What locvol writes it can read: the boundary is closed, and bounds the mesh's volume.
    def test_boundary_is_a_volume(self):
        volume = volumes(self.mesh.points, self.mesh.cells).sum()
        for name in ("c.stl", "c.ply", "c.obj"):
            facts = json.loads(locvol("info", self.export(name), "--json"))
            self.assertAlmostEqual(facts["volume"], volume, delta=1e-6 * volume)
            self.assertEqual(facts["num_triangles"], len(self.facets))
            self.assertEqual(facts["euler_characteristic"], self.audit["euler_characteristic"])


class Sheets(unittest.TestCase):
    """A box whose sides have names, and so have its edges."""

    PLANES = [(2, 0), (2, 1), (1, 0), (1, 2), (0, 0), (0, 3)]  # of the sides: axis, place
    NAMES = ["below", 'above "top" ß', "front", "back", "inlet", "outlet"]
    SIDES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]

    def setUp(self):
        self.directory = tempfile.TemporaryDirectory()
        self.addCleanup(self.directory.cleanup)
        surface, mesh = self.path("box.obj"), self.path("box.vtu")
        with open(surface, "w", encoding="utf-8") as text:
            for v in range(8):
                text.write(f"v {3 * (v & 1)} {v & 2} {v >> 2}\n")
            for name, side in zip(self.NAMES, self.SIDES):
                text.write(f"g {name}\nf {' '.join(str(v + 1) for v in side)}\n")
        self.store = self.path("store")
        summary = json.loads(locvol("mesh", surface, "-o", mesh, "--size", "15%", "--store",
                                    self.store, "--quiet", "--json"))
        self.assertEqual([sheet["name"] for sheet in summary["sheets"]], self.NAMES)
        self.points = read_vtu(mesh).points

    def path(self, name):
        return os.path.join(self.directory.name, name)

    def export(self, name, *arguments):
        locvol("export", self.store, "-o", self.path(name), *arguments)
        return self.path(name)

    def expect_sides(self, facets, sheets):
        """Facets whose corners all lie in one side are of its sheet; so are most."""
        corners = self.points[facets]
        inside = 0
        for sheet in range(1, 7):
            axis, end = self.PLANES[sheet - 1]
            lies_in = (corners[:, :, axis] == end).all(axis=1)
            self.assertTrue((sheets[lies_in] == sheet).all())
            inside += lies_in.sum()
        self.assertGreater(inside, 0.7 * len(facets))

    def creases(self, rename=lambda name: name):
        """Of each name the two sides that meet there."""
        return {rename(f"{self.NAMES[a]}/{self.NAMES[b]}"): (a, b)
                for a in range(6) for b in range(a + 1, 6)
                if self.PLANES[a][0] != self.PLANES[b][0]}

    def vertices_on(self, sides):
        planes = [self.PLANES[side] for side in sides]
        return set(np.flatnonzero(np.all([self.points[:, axis] == end for axis, end in planes],
                                         axis=0)))

    def expect_creases(self, lines, sides):
        """The edges of a crease, of which each has two vertices of both sides, make all of it."""
        self.assertTrue(np.isin(lines, list(self.vertices_on(sides))).all())
        a, b = self.points[lines[:, 0]], self.points[lines[:, 1]]
        axis = ({0, 1, 2} - {self.PLANES[side][0] for side in sides}).pop()
        self.assertAlmostEqual(np.linalg.norm(a - b, axis=1).sum(), [3, 2, 1][axis])

    def expect_crease_ids(self, lines, ids):
        self.assertEqual(set(ids), set(range(1, 13)))
        on = {pair: self.vertices_on(pair) for pair in self.creases().values()}
        for crease in range(1, 13):
            of_crease = lines[ids == crease]
            sides = [pair for pair in on if set(of_crease.ravel()) <= on[pair]]
            self.assertEqual(len(sides), 1)
            self.expect_creases(of_crease, sides[0])

    def corners(self):
        return np.flatnonzero(np.isin(self.points, [0, 1, 2, 3]).all(axis=1) & np.all(
            [(self.points[:, axis] == 0) | (self.points[:, axis] == [3, 2, 1][axis])
             for axis in range(3)], axis=0))

    def test_gmsh(self):
        for options in ([], ["--format", "msh2"]):
            gmsh.initialize()
            gmsh.option.setNumber("General.Terminal", 0)
            gmsh.open(self.export("box.msh", *options))
            groups = {gmsh.model.getPhysicalName(*group): group
                      for group in gmsh.model.getPhysicalGroups()}
            expected = {name.replace('"', "_"): (2, sheet + 1)
                        for sheet, name in enumerate(self.NAMES)}
            creases = self.creases(lambda name: name.replace('"', "_"))
            of_creases = {name: groups.pop(name) for name in creases}
            of_corners = {name: group for name, group in groups.items() if group[0] == 0}
            self.assertEqual({dimension for dimension, _ in of_creases.values()}, {1})
            self.assertEqual(set(of_corners), {f"corner {corner}" for corner in range(1, 9)})
            numbers = [number for _, number in (*of_creases.values(), *groups.values())]
            self.assertEqual(sorted(numbers), list(range(1, 28)))
            self.assertEqual({name: group for name, group in groups.items() if group[0] > 0},
                             {**expected, "volume": (3, 7)})
            for name, group in of_creases.items():
                entity, = gmsh.model.getEntitiesForPhysicalGroup(*group)
                lines = gmsh.model.mesh.getElements(1, entity)[2][0].astype(np.int64) - 1
                self.expect_creases(lines.reshape(-1, 2), creases[name])
                if not options:
                    self.assertEqual(len(gmsh.model.getBoundary([(1, entity)])), 2)
            vertices = [gmsh.model.mesh.getNodesForPhysicalGroup(*group)[0][0] - 1
                        for group in of_corners.values()]
            np.testing.assert_array_equal(np.sort(np.array(vertices, np.int64)), self.corners())
            tags = np.concatenate([gmsh.model.mesh.getElementsByType(kind)[0]
                                   for kind in (1, 2, 4, 15)])
            self.assertEqual(sorted(tags), list(range(1, len(tags) + 1)))
            facets, sheets = [], []
            for sheet in range(1, 7):
                for entity in gmsh.model.getEntitiesForPhysicalGroup(2, sheet):
                    _, tags, nodes = gmsh.model.mesh.getElements(2, entity)
                    facets.append(nodes[0].astype(np.int64).reshape(-1, 3) - 1)
                    sheets.append(np.full(len(tags[0]), sheet))
            gmsh.finalize()
            self.expect_sides(np.concatenate(facets), np.concatenate(sheets))

    def test_vtk(self):
        for name, reader, options in (("box.vtu", vtk.vtkXMLUnstructuredGridReader(), []),
                                      ("zlib.vtu", vtk.vtkXMLUnstructuredGridReader(),
                                       ["--format", "vtu-zlib"]),
                                      ("box.vtkhdf", vtk.vtkHDFReader(), [])):
            reader.SetFileName(self.export(name, "--boundary", *options))
            reader.Update()
            grid = reader.GetOutput()
            types = vtk_to_numpy(grid.GetCellTypesArray())
            kinds = [vtk.VTK_TETRA, vtk.VTK_TRIANGLE, vtk.VTK_LINE, vtk.VTK_VERTEX]
            nums = [np.count_nonzero(types == kind) for kind in kinds]
            np.testing.assert_array_equal(types, np.repeat(kinds, nums))
            parts = np.split(vtk_to_numpy(grid.GetCells().GetConnectivityArray()),
                             np.cumsum(np.multiply(nums, [4, 3, 2, 1]))[:3])
            data = arrays_of(grid.GetCellData())
            sheets = np.split(data["sheet"], np.cumsum(nums)[:3])
            creases = np.split(data["crease"], np.cumsum(nums)[:3])
            for part in (sheets[0], sheets[2], sheets[3], creases[0], creases[1], creases[3]):
                self.assertTrue((part == 0).all())
            self.expect_sides(parts[1].reshape(-1, 3), sheets[1])
            self.expect_crease_ids(parts[2].reshape(-1, 2), creases[2])
            groups = {name: list(values) for name, values in arrays_of(grid.GetFieldData()).items()}
            named = self.creases(lambda n: n.replace("/", "_") if "hdf" in name else n)
            self.assertEqual({name: group for name, group in groups.items() if group[1] == 2},
                             {name: [sheet + 1, 2] for sheet, name in enumerate(self.NAMES)})
            self.assertEqual({name for name, group in groups.items() if group[1] == 1}, set(named))
            for crease, sides in named.items():
                self.expect_creases(parts[2].reshape(-1, 2)[creases[2] == groups[crease][0]],
                                    sides)
            corners = arrays_of(grid.GetPointData())["corner"]
            np.testing.assert_array_equal(np.flatnonzero(corners), self.corners())
            np.testing.assert_array_equal(corners[parts[3]], np.arange(1, 9))

    def test_meshio_and_tetgen(self):
        mesh = meshio.read(self.export("box.vtu", "--boundary"))
        self.expect_sides(mesh.cells_dict["triangle"], mesh.cell_data_dict["sheet"]["triangle"])
        for sheet, name in enumerate(self.NAMES):
            np.testing.assert_array_equal(mesh.field_data[name], [sheet + 1, 2])
        faces = np.loadtxt(self.export("box.node", "--boundary").replace(".node", ".face"),
                           dtype=np.int64, skiprows=1)
        self.expect_sides(faces[:, 1:4] - 1, faces[:, 4])
        edges = np.loadtxt(self.path("box.edge"), dtype=np.int64, skiprows=1)
        self.expect_crease_ids(edges[:, 1:3] - 1, edges[:, 3])

    def test_medit(self):
        for name in ("box.mesh", "box.meshb"):
            mesh = meshio.read(self.export(name))
            self.expect_sides(mesh.cells_dict["triangle"],
                              mesh.cell_data_dict["medit:ref"]["triangle"])
            self.expect_crease_ids(mesh.cells_dict["line"],
                                   mesh.cell_data_dict["medit:ref"]["line"])
        with open(self.path("box.mesh"), encoding="utf-8") as text:
            words = text.read().split()
        num_edges = len(mesh.cells_dict["line"])
        for name, expected in (("Ridges", np.arange(num_edges) + 1),
                               ("Corners", self.corners() + 1),
                               ("RequiredVertices", self.corners() + 1)):
            start = words.index(name) + 1
            found = np.array(words[start:start + 1 + len(expected)], np.int64)
            self.assertEqual(found[0], len(expected))
            np.testing.assert_array_equal(np.sort(found[1:]), expected)

    def read_second_order(self, reader, name, *options):
        """Points, the lines of creases and these; lines go through nodes of cells."""
        reader.SetFileName(self.export(name, "--order", "2", "--boundary", *options))
        reader.Update()
        grid = reader.GetOutput()
        types = vtk_to_numpy(grid.GetCellTypesArray())
        kinds = [vtk.VTK_QUADRATIC_TETRA, vtk.VTK_QUADRATIC_TRIANGLE, vtk.VTK_QUADRATIC_EDGE,
                 vtk.VTK_VERTEX]
        nums = [np.count_nonzero(types == kind) for kind in kinds]
        np.testing.assert_array_equal(types, np.repeat(kinds, nums))
        cells, _, lines, corners = np.split(
            vtk_to_numpy(grid.GetCells().GetConnectivityArray()).astype(np.int64),
            np.cumsum(np.multiply(nums, [10, 6, 3, 1]))[:3])
        cells, lines = cells.reshape(-1, 10), lines.reshape(-1, 3)
        nodes = {tuple(sorted(cell[[i, j]])): cell[4 + k] for cell in cells
                 for k, (i, j) in enumerate(SecondOrder.EDGES)}
        self.assertEqual([nodes[tuple(sorted(line[:2]))] for line in lines], list(lines[:, 2]))
        creases = arrays_of(grid.GetCellData())["crease"]
        self.assertEqual(np.count_nonzero(creases), len(lines))
        ids = creases[types == vtk.VTK_QUADRATIC_EDGE]
        self.expect_crease_ids(lines[:, :2], ids)
        of_points = arrays_of(grid.GetPointData())["corner"]
        self.assertEqual(len(of_points), grid.GetNumberOfPoints())
        np.testing.assert_array_equal(np.flatnonzero(of_points), self.corners())
        np.testing.assert_array_equal(of_points[corners], np.arange(1, 9))
        return vtk_to_numpy(grid.GetPoints().GetData()), lines, ids

    def test_second_order(self):
        points, lines, ids = self.read_second_order(vtk.vtkXMLUnstructuredGridReader(), "two.vtu")
        ends = points[lines[:, :2]]
        np.testing.assert_array_equal(points[lines[:, 2]], (ends[:, 0] + ends[:, 1]) / 2)
        rows = np.column_stack([lines, ids])
        for reader, name, options in (
                (vtk.vtkXMLUnstructuredGridReader(), "z.vtu", ["--format", "vtu-zlib"]),
                (vtk.vtkHDFReader(), "two.vtkhdf", [])):
            _, found, of_found = self.read_second_order(reader, name, *options)
            np.testing.assert_array_equal(np.column_stack([found, of_found]), rows)
        self.expect_second_order_gmsh(rows)
        with open(self.export("two.mesh", "--order", "2"), encoding="utf-8") as text:
            words = text.read().split()
        self.assertFalse({"Edges", "Ridges"} & set(words))
        start = words.index("EdgesP2") + 2
        found = np.array(words[start:start + 4 * len(rows)], np.int64).reshape(-1, 4)
        np.testing.assert_array_equal(found - [1, 1, 1, 0], rows)
        self.assertEqual(int(words[start - 1]), len(rows))
        for name in ("Corners", "RequiredVertices"):
            start = words.index(name) + 2
            found = np.sort(np.array(words[start:start + 8], np.int64)) - 1
            np.testing.assert_array_equal(found, self.corners())
        np.testing.assert_array_equal(self.meshb_edges() - [1, 1, 1, 0], rows)
        self.export("two.node", "--order", "2", "--boundary")
        found = np.loadtxt(self.path("two.edge"), dtype=np.int64, skiprows=1)[:, 1:]
        np.testing.assert_array_equal(found - [1, 1, 1, 0], rows)
        sets = meshio.read(self.export("two.inp", "--order", "2")).point_sets
        for crease in range(1, 13):
            self.assertIn(set(rows[ids == crease, :3].ravel()), [set(of) for of in sets.values()])
        found = np.sort([vertex for name, of in sets.items() if "corner" in name for vertex in of])
        np.testing.assert_array_equal(found, self.corners())

    def expect_second_order_gmsh(self, rows):
        for options in ([], ["--format", "msh2"]):
            gmsh.initialize()
            gmsh.option.setNumber("General.Terminal", 0)
            gmsh.open(self.export("two.msh", "--order", "2", *options))
            found = [np.column_stack([nodes.astype(np.int64).reshape(-1, 3) - 1,
                                      np.full(len(nodes) // 3, crease)])
                     for crease in range(1, 13)
                     for kinds, _, (nodes,) in [gmsh.model.mesh.getElements(1, crease)]
                     if list(kinds) == [8]]
            num_groups = len(gmsh.model.getPhysicalGroups())
            points = gmsh.model.mesh.getElementsByType(15)[1].astype(np.int64) - 1
            gmsh.finalize()
            self.assertEqual(num_groups, 27)
            np.testing.assert_array_equal(np.sort(points), self.corners())
            found = np.concatenate(found)
            np.testing.assert_array_equal(found[np.lexsort(found.T)], rows[np.lexsort(rows.T)])

    def meshb_edges(self):
        """EdgesP2, whose keyword is 25."""
        with open(self.export("two.meshb", "--order", "2"), "rb") as file:
            data = file.read()
        place, found = 8, None
        while True:
            keyword, end = np.frombuffer(data, "<i4", 2, place)
            self.assertNotIn(keyword, (5, 14))
            if keyword == 54:
                return found
            if keyword == 25:
                found = np.frombuffer(data[place + 12:end], "<i4").reshape(-1, 4)
            place = end

    def test_abaqus(self):
        mesh = meshio.read(self.export("box.inp"))
        names = ["below", "above__top___", "front", "back", "inlet", "outlet"]
        creases = self.creases(lambda name: "".join(
            c if c.isascii() and c.isalnum() else "_" for c in name.replace("ß", "_")))
        corners = [f"corner_{corner}" for corner in range(1, 9)]
        self.assertEqual(set(mesh.point_sets), {"boundary", *names, *creases, *corners})
        for name, sides in creases.items():
            self.assertEqual(set(mesh.point_sets[name]), self.vertices_on(sides))
        np.testing.assert_array_equal(
            np.sort(np.concatenate([mesh.point_sets[name] for name in corners])), self.corners())
        medit = meshio.read(self.export("box.mesh"))
        sheets = medit.cell_data_dict["medit:ref"]["triangle"]
        for sheet, name in enumerate(names):
            facets = medit.cells_dict["triangle"][sheets == sheet + 1]
            np.testing.assert_array_equal(np.sort(mesh.point_sets[name]), np.unique(facets))


class GmshFiles:
    """What Gmsh makes of files that it merges: of nodes, cells and facets the tags, in order."""

    def __init__(self, *files, kinds=(4, 2)):
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        for file in files:
            gmsh.merge(file)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        # Gmsh 4.8 lists a node once for each file that has it.
        self.nodes, first = np.unique(tags, return_index=True)
        self.points = coordinates.reshape(-1, 3)[first]
        self.are_equal = (self.points[np.searchsorted(self.nodes, tags)]
                          == coordinates.reshape(-1, 3)).all()
        self.cell_tags, self.cells = self.elements(kinds[0])
        self.facet_tags, self.facets = self.elements(kinds[1])
        self.partitions = [list(gmsh.model.getPartitions(3, entity))
                           for _, entity in gmsh.model.getEntities(3)]
        self.groups = {gmsh.model.getPhysicalName(*group): group[0]
                       for group in gmsh.model.getPhysicalGroups() if group[0] >= 2}
        gmsh.finalize()

    @staticmethod
    def elements(kind):
        tags, vertices = gmsh.model.mesh.getElementsByType(kind)
        order = np.argsort(tags)
        return tags[order], vertices.astype(np.int64).reshape(len(tags), -1)[order]


class SecondOrder(unittest.TestCase):
    """Cells of ten nodes: the same in all formats, and not turned inside out anywhere."""

    EDGES = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]  # VTK's order of nodes 4 to 9

    @classmethod
    def setUpClass(cls):
        cls.directory = tempfile.TemporaryDirectory()
        surface, cls.store = cls.path("three.stl"), cls.path("store")
        locvol("generate", "three-holes", "-o", surface, "-n", "20k")
        summary = locvol("mesh", surface, "-o", cls.path("mesh.vtu"), "--size", "12%", "--store",
                         cls.store, "--quiet", "--leaf-capacity", "300", "--order", "2",
                         "--boundary", "--json")
        cls.written = json.loads(summary)["written"]
        cls.points, cls.cells, cls.facets = cls.read_vtk(vtk.vtkXMLUnstructuredGridReader(),
                                                         cls.path("mesh.vtu"))

    @classmethod
    def tearDownClass(cls):
        cls.directory.cleanup()

    @classmethod
    def path(cls, name):
        return os.path.join(cls.directory.name, name)

    def export(self, name, *arguments):
        file = self.path(name)
        locvol("export", self.store, "-o", file, "--order", "2", *arguments)
        return file

    @staticmethod
    def read_vtk(reader, file):
        reader.SetFileName(file)
        reader.Update()
        grid = reader.GetOutput()
        is_cell = vtk_to_numpy(grid.GetCellTypesArray()) == vtk.VTK_QUADRATIC_TETRA
        num_cells = is_cell.sum()
        assert is_cell[:num_cells].all()
        assert (vtk_to_numpy(grid.GetCellTypesArray())[num_cells:]
                == vtk.VTK_QUADRATIC_TRIANGLE).all()
        nodes = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).astype(np.int64)
        return (vtk_to_numpy(grid.GetPoints().GetData()).astype(float),
                nodes[:10 * num_cells].reshape(-1, 10), nodes[10 * num_cells:].reshape(-1, 6))

    def expect_same(self, points, cells, facets, tolerance=0):
        self.assertLessEqual(np.abs(points - self.points).max(), tolerance)
        np.testing.assert_array_equal(cells, self.cells)
        order = np.lexsort(self.facets.T)
        facets = np.asarray(facets)
        np.testing.assert_array_equal(facets[np.lexsort(facets.T)], self.facets[order])

    def test_nodes_are_between_their_ends(self):
        self.assertEqual(len(self.points), self.written["num_vertices"] + self.written["num_nodes"])
        self.assertEqual(self.written["order"], 2)
        self.assertGreater(self.written["num_nodes_on_surface"], 1000)
        inner = np.setdiff1d(self.cells, self.facets)
        for k, (i, j) in enumerate(self.EDGES):
            a, b, node = (self.points[self.cells[:, n]] for n in (i, j, 4 + k))
            off = np.linalg.norm(node - (a + b) / 2, axis=1)
            self.assertTrue((off <= 0.25 * np.linalg.norm(b - a, axis=1)).all())
            self.assertTrue((off[np.isin(self.cells[:, 4 + k], inner)] == 0).all())
        for k, (i, j) in enumerate([(0, 1), (1, 2), (2, 0)]):
            a, b, node = (self.points[self.facets[:, n]] for n in (i, j, 3 + k))
            self.assertTrue((np.linalg.norm(node - (a + b) / 2, axis=1)
                             <= 0.25 * np.linalg.norm(b - a, axis=1)).all())

    def test_vtk(self):
        for name, reader, options in (
                ("zlib.vtu", vtk.vtkXMLUnstructuredGridReader(), ["--format", "vtu-zlib"]),
                ("mesh.vtkhdf", vtk.vtkHDFReader(), [])):
            self.expect_same(*self.read_vtk(reader, self.export(name, "--boundary", *options)))

    def test_gmsh(self):
        facts = json.loads(locvol("info", self.path("three.stl"), "--json"))
        for options in ([], ["--format", "msh2"]):
            gmsh.initialize()
            gmsh.option.setNumber("General.Terminal", 0)
            gmsh.open(self.export("mesh.msh", *options))
            tags, coordinates, _ = gmsh.model.mesh.getNodes()
            points = np.empty((len(tags), 3))
            points[tags.astype(np.int64) - 1] = coordinates.reshape(-1, 3)
            cells = gmsh.model.mesh.getElementsByType(11)[1].astype(np.int64).reshape(-1, 10) - 1
            facets = gmsh.model.mesh.getElementsByType(9)[1].astype(np.int64).reshape(-1, 6) - 1
            places, weights = gmsh.model.mesh.getIntegrationPoints(11, "Gauss4")
            _, determinants, _ = gmsh.model.mesh.getJacobians(11, places)
            gmsh.finalize()
            self.expect_same(points, cells[:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]], facets)
            self.assertGreater(determinants.min(), 0)
            volume = (determinants.reshape(-1, len(weights)) @ weights).sum()
            straight = volumes(self.points, self.cells).sum()
            # The shape is smooth: cells that are curved leave out a tenth of what straight ones do.
            self.assertLess(abs(volume - facts["volume"]), 0.1 * abs(straight - facts["volume"]))

    def test_medit(self):
        with open(self.export("mesh.mesh")) as text:
            words = text.read().split()
        self.assertEqual(words[-1], "End")

        def section(name, kind, width):
            start = words.index(name) + 2
            count = int(words[start - 1])
            rows = np.array(words[start:start + width * count], dtype=kind).reshape(-1, width)
            return rows[:, :-1]

        self.expect_same(section("Vertices", float, 4), section("TetrahedraP2", np.int64, 11) - 1,
                         section("TrianglesP2", np.int64, 7) - 1)
        # Version, dimension; then each keyword with the place of the next and its count.
        with open(self.export("mesh.meshb"), "rb") as file:
            data = file.read()
        rows, place = {}, 8
        while True:
            keyword, end = np.frombuffer(data, "<i4", 2, place)
            if keyword == 54:
                break
            if keyword != 3:
                rows[keyword] = (np.frombuffer(data, "<i4", 1, place + 8)[0],
                                 data[place + 12:end])
            place = end
        count, values = rows[4]
        points = np.frombuffer(values, [("at", "<f8", 3), ("reference", "<i4")])
        self.assertEqual(count, len(points))
        cells = np.frombuffer(rows[30][1], "<i4").reshape(-1, 11)
        facets = np.frombuffer(rows[24][1], "<i4").reshape(-1, 7)
        self.expect_same(points["at"], cells[:, :10] - 1, facets[:, :6] - 1)

    def test_abaqus(self):
        mesh = meshio.read(self.export("mesh.inp"))
        np.testing.assert_array_equal(mesh.cells_dict["tetra10"], self.cells)
        self.assertLessEqual(np.abs(mesh.points - self.points).max(), 1e-13)
        np.testing.assert_array_equal(np.sort(mesh.point_sets["boundary"]), np.unique(self.facets))

    # As `tetgen -o2` has them.
    def test_tetgen(self):
        file = self.export("mesh.node", "--boundary")
        points = np.loadtxt(file, skiprows=1)[:, 1:]
        cells, facets = (np.loadtxt(file.replace(".node", end), dtype=np.int64, skiprows=1)
                         for end in (".ele", ".face"))
        with open(self.path("mesh.ele")) as text:
            self.assertEqual(text.readline().split(), [str(len(cells)), "10", "0"])
        ends = [(2, 3), (0, 3), (0, 1), (1, 2), (1, 3), (0, 2)]
        order = [4 + ends.index(edge) for edge in self.EDGES]
        self.expect_same(points, cells[:, 1:][:, [0, 1, 2, 3, *order]] - 1,
                         facets[:, 1:7][:, [0, 1, 2, 5, 3, 4]] - 1)


@unittest.skipUnless(MPIRUN, "needs locvol-mpi")
class Pieces(unittest.TestCase):
    """What three ranks write, each a file, against the mesh that one process writes."""

    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.directory = directory.name

    def path(self, *names):
        return os.path.join(self.directory, *names)

    def ranks(self, *arguments):
        run([MPIRUN, "-n", "3", LOCVOL_MPI, *arguments, "--quiet"], env=MPI_ENVIRONMENT)

    def each_mesh(self):
        """One size for all cells, and cells that grow."""
        locvol("generate", "three-holes", "-o", self.path("three.stl"), "-n", "5k")
        for number, options in enumerate(([], ["--growth", "0.2"])):
            self.stores = self.path(f"part-{number}-%r")
            self.ranks("mesh", self.path("three.stl"), "-o", self.path("whole.vtu"), "--size", "8%",
                       "--leaf-capacity", "300", "--store", self.stores, *options)
            with self.subTest(options=options):
                yield read_vtu(self.path("whole.vtu"))

    def export(self, name, *arguments):
        """The directory that all files of the pieces are in, and no others."""
        written, moved = self.path("written"), self.path("moved")
        shutil.rmtree(moved, ignore_errors=True)
        os.mkdir(written)
        self.ranks("export", self.stores, "-o", os.path.join(written, name), "--pieces", *arguments)
        os.rename(written, moved)
        return moved

    def expect_whole(self, mesh, whole):
        ids = mesh.point_data["GlobalPointIds"]
        np.testing.assert_array_equal(mesh.points, whole.points[ids])
        np.testing.assert_array_equal(ids[mesh.cells], whole.cells)
        np.testing.assert_array_equal(mesh.cell_data["leaf"], whole.cell_data["leaf"])
        self.assertEqual(mesh.cell_data["min_dihedral_degrees"].shape, (len(whole.cells),))

    def test_vtk(self):
        for whole in self.each_mesh():
            for options, index, read, read_index in (
                    (("mesh.vtu",), "mesh.pvtu", read_vtu, read_pvtu),
                    (("mesh.vtu", "--format", "vtu-zlib"), "mesh.pvtu", read_vtu, read_pvtu),
                    (("mesh.vtkhdf",), "mesh.vtkhdf", read_vtkhdf, read_vtkhdf)):
                directory = self.export(*options, "--cell-data", "quality")
                index = os.path.join(directory, index)
                self.expect_whole(read_index(index), whole)
                num_cells = 0
                for file in sorted(set(os.listdir(directory)) - {os.path.basename(index)}):
                    piece = read(os.path.join(directory, file))
                    ids = piece.point_data["GlobalPointIds"]
                    self.assertEqual(len(np.unique(piece.cells)), len(ids))
                    cells = whole.cells[num_cells:num_cells + len(piece.cells)]
                    np.testing.assert_array_equal(ids[piece.cells], cells)
                    num_cells += len(piece.cells)
                self.assertEqual(num_cells, len(whole.cells))

    def test_second_order(self):
        for _ in self.each_mesh():
            self.ranks("export", self.stores, "-o", self.path("whole.vtu"), "--order", "2")
            whole, cells, _ = SecondOrder.read_vtk(vtk.vtkXMLUnstructuredGridReader(),
                                                   self.path("whole.vtu"))
            for name, index, reader in (
                    ("mesh.vtu", "mesh.pvtu", vtk.vtkXMLPUnstructuredGridReader()),
                    ("mesh.vtkhdf", "mesh.vtkhdf", vtk.vtkHDFReader())):
                directory = self.export(name, "--order", "2")
                points, found, _ = SecondOrder.read_vtk(reader, os.path.join(directory, index))
                ids = vtk_to_numpy(reader.GetOutput().GetPointData().GetArray("GlobalPointIds"))
                np.testing.assert_array_equal(points, whole[ids])
                np.testing.assert_array_equal(ids[found], cells)
            directory = self.export("mesh.msh", "--order", "2")
            files = [os.path.join(directory, f"mesh_{rank + 1}.msh") for rank in range(3)]
            merged = GmshFiles(*files, kinds=(11, 9))
            self.assertTrue(merged.are_equal)
            np.testing.assert_array_equal(merged.points, whole)
            found = merged.cells[:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]]
            np.testing.assert_array_equal(found, cells + 1)

    def test_gmsh(self):
        for whole in self.each_mesh():
            directory = self.export("mesh.msh")
            files = [os.path.join(directory, f"mesh_{rank + 1}.msh") for rank in range(3)]
            self.assertEqual(len(os.listdir(directory)), len(files))
            merged = GmshFiles(*files)
            self.assertTrue(merged.are_equal)
            np.testing.assert_array_equal(merged.nodes, np.arange(len(whole.points)) + 1)
            np.testing.assert_array_equal(merged.points, whole.points)
            np.testing.assert_array_equal(merged.cells, whole.cells + 1)
            facets, _ = boundary_of(whole.cells)
            np.testing.assert_array_equal(canonical(merged.facets), canonical(facets + 1))
            np.testing.assert_array_equal(np.concatenate([merged.cell_tags, merged.facet_tags]),
                                          np.arange(len(whole.cells) + len(facets)) + 1)
            self.assertEqual(merged.partitions, [[], [1], [2], [3]])
            self.assertEqual(merged.groups, {"volume": 3, "boundary": 2})
            num_cells = 0
            for rank, file in enumerate(files):
                piece = GmshFiles(file)
                self.assertEqual(piece.partitions, [[], [rank + 1]])
                self.assertEqual(piece.groups, merged.groups)
                np.testing.assert_array_equal(piece.nodes, np.unique(piece.cells))
                np.testing.assert_array_equal(piece.points, whole.points[piece.nodes - 1])
                np.testing.assert_array_equal(piece.cells, whole.cells[piece.cell_tags - 1] + 1)
                self.assertTrue(np.isin(piece.facets, piece.nodes).all())
                num_cells += len(piece.cells)
            self.assertEqual(num_cells, len(whole.cells))


if __name__ == "__main__":
    unittest.main()
