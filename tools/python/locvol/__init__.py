"""locvol fills a closed surface with tetrahedra, out of core.

    mesh = locvol.mesh("part.stl", size="2%")
    mesh.points, mesh.cells, mesh.boundary   # numpy arrays
    mesh.write("part.vtu")

Notes on surfaces go to the log `locvol` as warnings, stages of runs as information.
"""
from ._errors import (Error, InputError, InternalError, Interrupted, MemoryLimitError,
                      MismatchError, StoreError, SystemFailure)  # fmt: skip
from ._locvol import (Body, BoundaryChunk, Chunk, Distribution, Estimate, PoorCellPlace, Sheet,
                      Statistics, Status, Summary, SurfaceInfo, UnresolvedPlace,
                      share_one_heap)  # fmt: skip
from ._locvol import version as __version__
from ._mesh import Mesh
from ._options import Ball, Box, Segment
from ._runs import estimate, info, mesh, open

__all__ = [
    "Ball", "Body", "BoundaryChunk", "Box", "Chunk", "Distribution", "Error", "Estimate",
    "InputError", "InternalError", "Interrupted", "MemoryLimitError", "Mesh", "MismatchError",
    "PoorCellPlace", "Segment", "Sheet", "Statistics", "Status", "StoreError", "Summary",
    "SurfaceInfo", "SystemFailure", "UnresolvedPlace", "estimate", "info", "mesh", "open",
    "share_one_heap"]  # fmt: skip
