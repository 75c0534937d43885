#!/usr/bin/env python3
"""Heat in a bracket, by linear finite elements and scipy alone: Poisson's equation on a mesh of
locvol, with temperatures given on sheets by their names.

Needs bracket.py of the examples for CalculiX, python3-scipy, and for the picture
python3-matplotlib. Lengths are in millimeters; the conductivity is 1."""
import argparse
import pathlib
import sys

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

import locvol

sys.path.append(str(pathlib.Path(__file__).resolve().parent.parent / "calculix"))
from bracket import faces  # noqa: E402


def bracket():
    """Vertices, triangles, the group of each triangle and the names of groups."""
    named = faces()
    corners = np.array([corner for of_name in named.values() for t in of_name for corner in t])
    vertices, indices = np.unique(corners, axis=0, return_inverse=True)
    groups = np.repeat(np.arange(len(named)), [len(of_name) for of_name in named.values()])
    return (vertices, indices.reshape(-1, 3)), groups, list(named)


def stiffness(points, cells):
    """The matrix of the integrals of grad v_i . grad v_j, (n, n)."""
    corners = points[cells]
    edges = corners[:, 1:] - corners[:, :1]  # (m, 3, 3)
    volumes = np.linalg.det(edges) / 6
    gradients = np.linalg.inv(edges).transpose(0, 2, 1)  # of the last three barycentric coordinates
    gradients = np.concatenate([-gradients.sum(axis=1, keepdims=True), gradients], axis=1)
    local = volumes[:, None, None] * (gradients @ gradients.transpose(0, 2, 1))
    rows, columns = np.repeat(cells, 4, axis=1), np.tile(cells, 4)
    entries = (local.reshape(-1), (rows.reshape(-1), columns.reshape(-1)))
    return scipy.sparse.coo_matrix(entries, shape=(len(points),) * 2).tocsr()


def solve(mesh, temperatures):
    """The temperature at each point, and the heat that flows in at each sheet that has one.

    `temperatures`: by the sheets' names, numbers or functions of points."""
    matrix = stiffness(mesh.points, mesh.cells)
    values, is_given = np.zeros(len(mesh.points)), np.zeros(len(mesh.points), bool)
    nodes = {name: np.unique(mesh.boundary[mesh.facets_of(name)]) for name in temperatures}
    for name, temperature in temperatures.items():
        at = nodes[name]
        values[at] = temperature(mesh.points[at]) if callable(temperature) else temperature
        is_given[at] = True
    free = ~is_given
    right = -(matrix[free][:, is_given] @ values[is_given])
    solution, failed = scipy.sparse.linalg.cg(matrix[free][:, free], right, tol=1e-10)
    if failed:
        sys.exit("poisson.py: the conjugate gradients did not converge")
    values[free] = solution
    flow = matrix @ values
    return values, {name: flow[at].sum() for name, at in nodes.items()}


def draw(mesh, values, file):
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    corners = mesh.points[mesh.boundary]
    figure = pyplot.figure(figsize=(8, 6))
    axes = figure.add_subplot(projection="3d", box_aspect=np.ptp(mesh.points, axis=0))
    colors = pyplot.cm.inferno((values[mesh.boundary].mean(axis=1) - 20) / 80)
    axes.add_collection3d(Poly3DCollection(corners, facecolors=colors, edgecolors="#00000030",
                                           linewidths=0.3))  # fmt: skip
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.view_init(25, -55)
    axes.set_axis_off()
    scale = pyplot.cm.ScalarMappable(pyplot.Normalize(20, 100), "inferno")
    figure.colorbar(scale, ax=axes, shrink=0.6, label="temperature")
    figure.savefig(file, dpi=100, bbox_inches="tight")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", default="10%", help="of cells, as locvol has it")
    parser.add_argument("--picture", help="a file to draw, .png")
    arguments = parser.parse_args()
    surface, groups, names = bracket()
    mesh = locvol.mesh(surface, arguments.size, groups=groups, names=names)
    values, flow = solve(mesh, {"back": 20.0, "tip": 100.0})
    print(f"{len(mesh.cells)} cells, temperatures from {values.min():.6f} to {values.max():.6f}")
    for name, heat in flow.items():
        print(f"heat in at {name}: {heat:.4f}")
    if arguments.picture:
        draw(mesh, values, arguments.picture)


if __name__ == "__main__":
    main()
