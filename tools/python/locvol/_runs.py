"""Runs: begun, gone on with, told of beforehand."""
import inspect
import logging
import os

from . import _errors, _locvol, _options
from ._surface import surface_of

log = logging.getLogger("locvol")

# What `info` depends on.
_OF_SURFACE = ("weld", "sharp_angle", "sharp", "has_bodies", "voids", "gap", "inside",
               "wrap_alpha", "wrap_offset")  # fmt: skip


def _note(text):
    log.warning("%s", _options.in_python(text))


def memory_bytes(memory):
    """Of a number of bytes, or a text such as "2G", "512M" or "25%" of what is free; None: 0."""
    if memory is None:
        return 0
    if isinstance(memory, str):
        return _locvol.memory_bytes(memory)
    if isinstance(memory, bool) or memory != int(memory) or memory <= 0:
        raise _errors.InputError(f"memory {memory!r}: give bytes above 0, or a text such as '2G'")
    return int(memory)


def watched(run, progress, take):
    """Does run(progress, on_note), which gives a mesh and what Python has raised meanwhile.

    Returns take(mesh), or raises Interrupted with that."""
    stage = None

    def tell(status):
        nonlocal stage
        if status.stage != stage:
            stage = status.stage
            log.info("%s: %d leaves, %d cells", stage, status.num_leaves, status.num_cells)
        return None if progress is None else progress(status)

    held, raised = run(tell, _note)
    mesh = None if held is None else take(held)
    if raised is not None and not isinstance(raised, KeyboardInterrupt):
        raise raised
    if raised is None and mesh is not None and mesh.is_complete:
        return mesh
    if mesh is None:
        error = _errors.Interrupted("the run: stopped while the surface was read; begin it again")
    else:
        error = _errors.Interrupted(f"{mesh.store}: stopped after a commit; resume it to go on")
    error.mesh = mesh
    raise error from raised


def mesh(surface, size=None, *, memory=None, store=None, threads=0, progress=None, groups=None,
         names=None, force=False, scratch=None, **options):  # fmt: skip
    """Fills a closed surface with tetrahedra, on disk.

    The mesh depends on the surface and the options alone, and not on memory, threads, or
    interruptions: the same call goes on with a run that was stopped or killed, to the same bytes.
    While it meshes, other threads of Python go on.

    Args:
        surface: The name of a file (STL, OBJ, OFF, PLY, VTK polydata, Gmsh, 3MF, glTF); a list of
            files, each of which is a body; a pair (vertices, triangles), arrays of shape (n, 3);
            or an object with such: of PyVista, VTK, trimesh or meshio.
        memory: What the run may take: bytes, or a text such as "2G". None: half of what is free.
        store: The directory that keeps the run, made if it is not there. None: one that goes with
            the mesh.
        threads (int): 0: as many as the process may use.
        progress: Called with a Status, by this thread, about ten times a second; once it returns
            False, the run is stopped.
        groups: Of triangles in arrays, (n,) whole numbers: of each the index of its name.
        names: A list of names; groups become sheets, or bodies with has_bodies=True.
        force (bool): Begins anew over the store of another run, which is lost.
        scratch: Where a store without a name is made. None: the system's directory for temporary
            files, which may lie in memory.
{options}

    Returns:
        Mesh: Complete.

    Raises:
        InputError: The surface or an option is refused; the message names place and cure.
        MismatchError: The store holds another run.
        MemoryLimitError: `memory` is too small; the message has the least that would do.
        Interrupted: By Ctrl-C or `progress`, after a commit.
        StoreError, SystemFailure: Of store and disk.
    """
    given = {**options, "size": size}
    held_surface = surface_of(surface, groups, names)
    bytes_ = memory_bytes(memory)
    scratch = "" if scratch is None else os.fspath(scratch)
    if size is None:
        given["size"] = _chosen_size(held_surface, options, scratch, bytes_, threads)
    return watched(
        lambda *last: _locvol.mesh(held_surface, given, "" if store is None else os.fspath(store),
                                   scratch, force, bytes_, threads, *last),
        progress, lambda held: _mesh_of(held, bytes_, threads))  # fmt: skip


def _mesh_of(held, bytes_, threads):
    from ._mesh import Mesh  # which resumes runs

    return Mesh(held, bytes_, threads)


def _chosen_size(held_surface, options, scratch, bytes_, threads):
    of_surface = {name: options[name] for name in _OF_SURFACE if name in options}
    known = _locvol.info(held_surface, of_surface, scratch, bytes_, threads, _note)
    if not known.default_size > 0:
        raise _errors.InputError(
            "the surface: its volume is 0, so no size can be chosen for it; give a size")
    log.info("size %g is chosen, for about half a million cells, or more where parts are thin",
             known.default_size)  # fmt: skip
    return known.default_size


def open(store, *, memory=None, threads=0):
    """Opens the run in a store as it is, finished or not.

    Args:
        store: Its directory.
        memory, threads: As of `mesh`; for what is done with it.

    Returns:
        Mesh: Whose `resume` goes on with it, if it is unfinished.

    Raises:
        StoreError: There is none, or it is damaged.
    """
    bytes_ = memory_bytes(memory)
    return _mesh_of(_locvol.open(os.fspath(store), bytes_, threads), bytes_, threads)


def info(surface, *, memory=None, threads=0, groups=None, names=None, scratch=None, **options):
    """Reads and checks a surface as `mesh` does, and refuses what that would refuse.

    Args:
        surface, memory, threads, groups, names, scratch: As of `mesh`.
        options: Of those of `mesh`: weld, sharp_angle, sharp, has_bodies, voids, gap, inside,
            wrap_alpha, wrap_offset.

    Returns:
        SurfaceInfo: Counts, area, volume, sheets, bodies; and `default_size`.

    Raises:
        InputError: The surface is refused.
    """
    unknown = [name for name in options if name not in _OF_SURFACE]
    if unknown:
        known = ", ".join(_OF_SURFACE)
        raise TypeError(f"info depends on no option '{unknown[0]}', but on {known}")
    return _locvol.info(surface_of(surface, groups, names), options,
                        "" if scratch is None else os.fspath(scratch), memory_bytes(memory),
                        threads, _note)  # fmt: skip


def estimate(surface, size=None, *, threads=0, memory=None, groups=None, names=None, scratch=None,
             **options):  # fmt: skip
    """Tells what a run will take.

    Args:
        surface: As of `mesh`; or a SurfaceInfo, then nothing is read.
        size, threads, memory, groups, names, scratch, options: As of `mesh`.

    Returns:
        Estimate: Cells, bytes, seconds, the least memory.
    """
    if not isinstance(surface, _locvol.SurfaceInfo):
        of_surface = {name: options[name] for name in _OF_SURFACE if name in options}
        surface = info(surface, memory=memory, threads=threads, groups=groups, names=names,
                       scratch=scratch, **of_surface)  # fmt: skip
    given = {**options, "size": surface.default_size if size is None else size}
    return _locvol.estimate(surface, given, threads)


def _sign(function):
    """Shows all options where a signature is asked for, and their help in the docstring."""
    known = inspect.signature(function)
    plain = [p for p in known.parameters.values() if p.kind is not p.VAR_KEYWORD]
    more = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None)
            for name in _options.names() if name not in known.parameters]  # fmt: skip
    function.__signature__ = known.replace(parameters=plain + more)
    if function.__doc__:  # python -OO has none
        function.__doc__ = function.__doc__.replace("{options}", _options.documentation())


_sign(mesh)
_sign(estimate)
