"""The mesh of a run."""
import json
import os
import pathlib

import numpy as np

from . import _arrays, _locvol, _runs


class Mesh:
    """The result of a run, which is kept in a store: a directory on a local disk.

    It holds nothing of the mesh in memory until it is asked for arrays. `mesh` and `open` make one.
    It may be used by several threads. A store without a name goes with it.
    """

    def __init__(self, held, memory_bytes, threads):
        self._held, self._memory_bytes, self._threads = held, memory_bytes, threads
        self._cells = self._boundary = None

    def __repr__(self):
        what = f"{self.summary.num_cells} cells" if self.is_complete else "unfinished"
        return f"<locvol.Mesh: {what}, in {str(self.store)!r}>"

    # -- The run

    @property
    def is_complete(self):
        """bool: The run is over. If not, `resume` goes on with it; until then there is no mesh."""
        return self._held.is_complete

    @property
    def summary(self):
        """Summary: Counts and measures; of an unfinished run, so far."""
        return self._held.summary

    @property
    def store(self):
        """pathlib.Path: Where the run is kept."""
        return pathlib.Path(self._held.store)

    def resume(self, *, memory=None, threads=None, progress=None):
        """Goes on with an unfinished run, to the same bytes as if nothing had stopped it.

        Args:
            memory, threads, progress: As of `mesh`; by default those that this mesh has.

        Returns:
            Mesh: This one, which is complete now.

        Raises:
            Interrupted: It was stopped again.
            StoreError: Another process works on it.
        """
        if memory is not None:
            self._memory_bytes = _runs.memory_bytes(memory)
        if threads is not None:
            self._threads = threads
        _runs.watched(
            lambda *last: _locvol.resume(self.store, self._memory_bytes, self._threads, *last),
            progress, self._took)  # fmt: skip
        return self

    def _took(self, held):
        self._keep_scratch = getattr(self, "_keep_scratch", None) or self._held
        self._held, self._cells, self._boundary = held, None, None
        return self

    # -- Arrays

    @property
    def points(self):
        """numpy.ndarray: (n, 3) float64, read-only: where the mesh's points lie."""
        return self._load_cells(None)[0]

    @property
    def cells(self):
        """numpy.ndarray: (m, 4) int64, read-only: indices into `points`, positively oriented."""
        return self._load_cells(None)[1]

    @property
    def bodies(self):
        """numpy.ndarray: (m,) uint32, read-only: of each cell the id of its body, from 1 on."""
        return self._load_cells(None)[2]

    @property
    def boundary(self):
        """numpy.ndarray: (k, 3) int64, read-only: the boundary's facets, and those between bodies.

        They are indices into `points`, counterclockwise from outside; between bodies, from that
        with the smaller id. A facet between two bodies is there once."""
        return self._load_boundary(None)[0]

    @property
    def sheets(self):
        """numpy.ndarray: (k,) uint32, read-only: of each facet of `boundary` its sheet's id."""
        return self._load_boundary(None)[1]

    @property
    def boundary_cells(self):
        """numpy.ndarray: (k,) int64, read-only: of each facet of `boundary` the cell behind it."""
        return self._load_boundary(None)[2]

    def load(self, mapped=None):
        """Makes the arrays that are not there yet; otherwise the first one that is asked for does.

        Args:
            mapped (bool | None): True: they are in nameless files beside the store, which are
                mapped and go with the arrays; False: in memory. None: in files if they take more than half
                of `memory`.

        Returns:
            Mesh: This one.
        """
        self._load_cells(mapped)
        self._load_boundary(mapped)
        return self

    def _directory(self, num_bytes, mapped):
        if mapped is None:
            mapped = num_bytes > _locvol.memory_cap(self._memory_bytes) // 2
        return self.store.absolute().parent if mapped else None

    def _load_cells(self, mapped):
        if self._cells is None:
            num_points, num_cells = self._held.num_points(), self.summary.num_cells
            directory = self._directory(24 * num_points + 36 * num_cells, mapped)
            points = _arrays.make((num_points, 3), np.float64, directory)
            cells = _arrays.make((num_cells, 4), np.int64, directory)
            bodies = None
            if self.body_list:
                bodies = _arrays.make((num_cells,), np.uint32, directory)
            self._held.fill(points, cells, bodies)
            if bodies is None:
                bodies = np.broadcast_to(np.uint32(1), (num_cells,))  # of 4 bytes in all
                self._cells = (_arrays.finished(points), _arrays.finished(cells), bodies)
            else:
                self._cells = tuple(map(_arrays.finished, (points, cells, bodies)))
        return self._cells

    def _load_boundary(self, mapped):
        if self._boundary is None:
            num = self._held.num_facets()
            directory = self._directory(36 * num, mapped)
            facets = _arrays.make((num, 3), np.int64, directory)
            sheets = _arrays.make((num,), np.uint32, directory)
            cells = _arrays.make((num,), np.int64, directory)
            self._held.fill_boundary(facets, sheets, cells, num)
            self._boundary = tuple(map(_arrays.finished, (facets, sheets, cells)))
        return self._boundary

    # -- Chunks

    def chunks(self, max_bytes=None, order=1):
        """Gives the mesh piece by piece, always the same ones in the same order.

        Args:
            max_bytes (int | None): About so many bytes of points and cells has a chunk; at least a
                leaf of the octree. None: a mebibyte, as have all of order 2.
            order (int): 2: cells have a node in the middle of each edge, too.

        Yields:
            Chunk: Some cells with all their points. It may be kept as long as you like.
        """
        return iter(self._held.chunks(order, 0 if max_bytes is None else max(1, int(max_bytes))))

    def boundary_chunks(self, order=1):
        """Gives the boundary piece by piece, always the same ones in the same order.

        Args:
            order (int): As of `chunks`.

        Yields:
            BoundaryChunk: Some facets.
        """
        return iter(self._held.boundary_chunks(order))

    # -- What it is like

    @property
    def sheet_list(self):
        """list[Sheet]: The sheets of the surface, measured there and on the mesh's boundary; that
        of id i is sheet_list[i - 1]. One that is called "boundary" if nothing parts it."""
        return self._held.sheets()

    @property
    def body_list(self):
        """list[Body]: The bodies, of several; that of id i is body_list[i - 1]. Empty: one body."""
        return self._held.bodies()

    def facets_of(self, sheet):
        """The facets of a sheet.

        Args:
            sheet (str | int): The name of a sheet or of a group of the surface, or a sheet's id.

        Returns:
            numpy.ndarray: (k,) int64, indices into `boundary`.

        Raises:
            KeyError: There is none of that name.
        """
        all_sheets = self.sheet_list
        ids = [s.id for s in all_sheets if sheet in (s.id, s.name, s.group) and sheet != ""]
        if not ids:
            raise KeyError(f"no sheet {sheet!r}: there are {', '.join(s.name for s in all_sheets)}")
        return np.flatnonzero(np.isin(self.sheets, ids))

    def statistics(self):
        """Statistics: Measures all cells."""
        return self._held.statistics()

    def unresolved(self, limit=1000):
        """list[UnresolvedPlace]: `limit` at most of the places where a promise is not kept."""
        return self._held.unresolved(limit)

    def poor_cells(self, limit=1000):
        """list[PoorCellPlace]: `limit` at most of the cells with an angle below `min_dihedral`."""
        return self._held.poor_cells(limit)

    def inspect(self, all_records=False):
        """Looks into the run, finished or not, also while another process works on it.

        Args:
            all_records (bool): Reads every record, to find damage.

        Returns:
            dict: What `locvol inspect DIR --json` prints (tools/inspect.md).
        """
        return json.loads(self._held.inspect(all_records))

    def audit(self, one_in=1):
        """Checks all promises from the stored bytes alone.

        Args:
            one_in (int): Checks one leaf in so many.

        Returns:
            dict: What `locvol audit DIR --json` prints; "is_valid" says how it went.
        """
        return json.loads(self._held.audit(one_in))

    def report(self, file, max_cells=None):
        """Writes a page about the run, with the mesh cut open, that a browser shows.

        Args:
            file (str | os.PathLike): .html
            max_cells (int | None): On the page; None: as many as a browser shows smoothly.

        Returns:
            int: Its bytes.
        """
        return self._held.report(os.fspath(file), max_cells or 0, self._num_threads())

    # -- Other programs

    def write(self, file, format=None, *, order=1, boundary=False, quality=False, faces=False,
              split_interfaces=False):  # fmt: skip
        """Writes the mesh; the bytes are those of the command's file.

        Args:
            file (str | os.PathLike): Appears under its name only when it is whole.
            format (str | None): Its name in the table of tools/formats.md; None: by the extension.
            order (int): 2: cells have a node in the middle of each edge, too.
            boundary (bool): With the triangles of the boundary and their sheets, in VTK's formats
                and TetGen's; others always have them.
            quality (bool): With the quality of the cells, in VTK's formats.
            faces (bool): Writes FILE.faces.json, too: what is known of each sheet.
            split_interfaces (bool): Each of several bodies has points of its own, for contact.

        Returns:
            int: Its bytes.

        Raises:
            InputError: The format cannot hold the mesh.
            SystemFailure: The file cannot be written.
        """
        return self._held.write(os.fspath(file), format or "", order, boundary, quality, faces,
                                split_interfaces, self._num_threads())  # fmt: skip

    def _num_threads(self):
        return _locvol.streaming_threads(self._threads, _locvol.memory_cap(self._memory_bytes))

    def to_meshio(self):
        """meshio.Mesh: Cells, and the boundary's triangles; ids of bodies and sheets as cell data
        "body" and "sheet", 0 where there is none; their names with id and dimension as field data.
        Arrays are shared."""
        import meshio

        data = {"body": [self.bodies, np.zeros(len(self.boundary), np.uint32)],
                "sheet": [np.zeros(len(self.cells), np.uint32), self.sheets]}  # fmt: skip
        names = {s.name: np.array([s.id, 2]) for s in self.sheet_list}
        names.update({b.name: np.array([b.id, 3]) for b in self.body_list})
        return meshio.Mesh(self.points, [("tetra", self.cells), ("triangle", self.boundary)],
                           cell_data=data, field_data=names)  # fmt: skip

    def to_vtk(self, boundary=False):
        """vtkUnstructuredGrid: The cells, with their ids of bodies as cell data "body".

        Args:
            boundary (bool): With the boundary's triangles behind the cells, whose ids are cell data
                "sheet"; 0 where there is none.

        Coordinates are shared, not copied.
        """
        from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
        from vtkmodules.vtkCommonCore import vtkPoints
        from vtkmodules.vtkCommonDataModel import VTK_TETRA, VTK_TRIANGLE
        from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkUnstructuredGrid

        connectivity, bodies = self.cells.reshape(-1), self.bodies
        offsets = np.arange(0, 4 * len(self.cells) + 1, 4, dtype=np.int64)
        types = np.full(len(self.cells), VTK_TETRA, np.uint8)
        if boundary:
            num = len(self.boundary)
            connectivity = np.concatenate([connectivity, self.boundary.reshape(-1)])
            more = offsets[-1] + 3 * np.arange(1, num + 1, dtype=np.int64)
            offsets = np.concatenate([offsets, more])
            types = np.concatenate([types, np.full(num, VTK_TRIANGLE, np.uint8)])
            sheets = np.concatenate([np.zeros(len(self.cells), np.uint32), self.sheets])
            bodies = np.concatenate([bodies, np.zeros(num, np.uint32)])
        grid, points, cells = vtkUnstructuredGrid(), vtkPoints(), vtkCellArray()
        points.SetData(numpy_to_vtk(self.points))
        grid.SetPoints(points)
        # Of these VTK takes the memory alone, and nobody would keep it: copies are VTK's own.
        cells.SetData(numpy_to_vtkIdTypeArray(offsets, deep=True),
                      numpy_to_vtkIdTypeArray(connectivity, deep=True))  # fmt: skip
        grid.SetCells(numpy_to_vtk(types), cells)
        named = {"body": bodies, **({"sheet": sheets} if boundary else {})}
        for name, values in named.items():
            array = numpy_to_vtk(np.ascontiguousarray(values))
            array.SetName(name)
            grid.GetCellData().AddArray(array)
        return grid

    def to_pyvista(self, boundary=False):
        """pyvista.UnstructuredGrid: As `to_vtk`."""
        import pyvista

        return pyvista.wrap(self.to_vtk(boundary))
