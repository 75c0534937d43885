"""What Python has of surfaces, as the library takes them."""
import os

import numpy as np

from . import _locvol
from ._errors import InputError


def surface_of(surface, groups=None, names=None):
    """The library's Surface of a path, paths, (vertices, triangles), or an object with these."""
    if isinstance(surface, (str, os.PathLike)):
        surface = [surface]
    if _are_paths(surface):
        if groups is not None:
            raise InputError("groups: a file has its own; leave them out")
        return _locvol.Surface.files([os.fspath(path) for path in surface])
    vertices, triangles = _arrays_of(surface)
    vertices = np.ascontiguousarray(vertices, dtype=np.float64)
    _require_rows(vertices, "the surface's vertices")
    triangles = _indices(triangles, "the surface's triangles", 2)
    _require_rows(triangles, "the surface's triangles")
    if (groups is None) != (names is None):
        raise InputError("groups and names belong together: give both, or none")
    if groups is None:
        return _locvol.Surface.arrays(vertices, triangles, None, [])
    groups = _indices(groups, "groups", 1)
    return _locvol.Surface.arrays(vertices, triangles, groups, [str(name) for name in names])


def _require_rows(array, what):
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"{what}: give an array of shape (n, 3), not {array.shape}")


def _are_paths(surface):
    return (isinstance(surface, (list, tuple)) and len(surface) > 0
            and all(isinstance(path, (str, os.PathLike)) for path in surface))  # fmt: skip


def _indices(values, what, ndim):
    array = np.asarray(values)
    if array.size == 0:
        array = array.astype(np.uint32)
    if array.dtype.kind not in "iu" or array.ndim != ndim:
        raise InputError(f"{what}: give whole numbers in an array of {ndim} dimensions")
    if array.size and (array.min() < 0 or array.max() > np.iinfo(np.uint32).max):
        raise InputError(f"{what}: {array.min()} to {array.max()}: give indices from 0 to 2^32 - 1")
    return np.ascontiguousarray(array, dtype=np.uint32)


def _arrays_of(surface):
    if isinstance(surface, (list, tuple)):
        if len(surface) != 2:
            raise InputError("the surface: give a path, or a pair (vertices, triangles)")
        return surface
    if hasattr(surface, "cells_dict"):  # meshio
        if "triangle" not in surface.cells_dict:
            raise InputError("the surface: has no cells of type 'triangle'; give a surface mesh")
        faces = [n for n in surface.cells_dict if n.startswith(("triangle", "quad", "polygon"))]
        others = [name for name in faces if name != "triangle"]
        if others:
            raise InputError(f"the surface: has cells of type '{others[0]}'; triangulate it before")
        return surface.points, surface.cells_dict["triangle"]
    if hasattr(surface, "GetPolys"):  # VTK, PyVista
        return _of_polydata(surface)
    if hasattr(surface, "points") and hasattr(surface, "faces"):
        return surface.points, _unpadded(surface.faces)
    if hasattr(surface, "vertices") and hasattr(surface, "faces"):  # trimesh
        return surface.vertices, surface.faces
    raise InputError(
        f"the surface: {type(surface).__name__} is none; give a path, a pair (vertices, "
        "triangles), or an object with points and faces, vertices and faces, or points and cells_dict")


def _unpadded(faces):
    """Triangles of VTK's faces, each behind the number of its corners, or of rows of three."""
    faces = np.asarray(faces)
    if faces.ndim == 2 and faces.shape[1] == 3:
        return faces
    flat = faces.reshape(-1)
    if flat.size % 4 or (flat[::4] != 3).any():
        raise InputError("the surface: has faces that are no triangles; triangulate it before")
    return flat.reshape(-1, 4)[:, 1:]


def _of_polydata(data):
    from vtkmodules.util.numpy_support import vtk_to_numpy

    if data.GetNumberOfStrips() or data.GetNumberOfPolys() == 0:
        raise InputError("the surface: has strips, or no polygons; triangulate it before")
    polys = data.GetPolys()
    num_corners = polys.GetNumberOfConnectivityIds()
    if polys.GetMaxCellSize() != 3 or num_corners != 3 * polys.GetNumberOfCells():
        raise InputError("the surface: has faces that are no triangles; triangulate it before")
    points = vtk_to_numpy(data.GetPoints().GetData())
    return points, vtk_to_numpy(polys.GetConnectivityArray()).reshape(-1, 3)
