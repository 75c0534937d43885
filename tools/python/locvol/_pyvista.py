"""The accessor `surface.locvol` of PyVista, 0.48 or later, which finds this module by itself: by
the entry point `pyvista.accessors` of the package."""
import pyvista

from ._runs import info, mesh


@pyvista.register_dataset_accessor("locvol", pyvista.PolyData)
class LocvolAccessor:
    """locvol, for a surface of PyVista."""

    def __init__(self, surface):
        self._surface = surface

    def mesh(self, size=None, **options):
        """pyvista.UnstructuredGrid: The mesh of the surface; arguments are those of locvol.mesh."""
        return mesh(self._surface, size, **options).to_pyvista()

    def run(self, size=None, **options):
        """locvol.Mesh: The run that makes it; arguments are those of locvol.mesh."""
        return mesh(self._surface, size, **options)

    def info(self, **options):
        """locvol.SurfaceInfo: Of the surface; arguments are those of locvol.info."""
        return info(self._surface, **options)
