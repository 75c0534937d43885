#!/usr/bin/env python3
"""Draws the pictures of the documents (python3-vtk9; without a display, under xvfb-run).

cut FILE.vtu OUT.png: the cells on one side of the middle plane x = const, by octree leaf; the
boundary of the mesh is paler. result FILE.vtu OUT.png: a result of examples/calculix, deformed.
"""
import sys

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

PALETTE = np.array(
    [(102, 194, 165), (252, 141, 98), (141, 160, 203), (231, 138, 195), (166, 216, 84)]
    + [(255, 217, 47), (229, 196, 148), (78, 163, 214), (217, 111, 111), (155, 127, 192)]
)
PALE = np.array((225, 228, 232))


def read(file):
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(file)
    reader.Update()
    return reader.GetOutput()


def surface_of(grid):
    surface = vtk.vtkDataSetSurfaceFilter()
    surface.SetInputData(grid)
    surface.PassThroughCellIdsOn()
    surface.Update()
    return surface.GetOutput()


def centers_of(surface):
    points = vtk_to_numpy(surface.GetPoints().GetData())
    corners = vtk_to_numpy(surface.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return [tuple(center) for center in np.round(points[corners].mean(axis=1), 9)]


def cut_open(grid):
    """The surface of the part with x below the middle, colored."""
    centers = vtk.vtkCellCenters()
    centers.SetInputData(grid)
    centers.Update()
    x = vtk_to_numpy(centers.GetOutput().GetPoints().GetData())[:, 0]
    kept = vtk.vtkIdList()
    for cell in np.nonzero(x < sum(grid.GetBounds()[:2]) / 2)[0]:
        kept.InsertNextId(int(cell))
    extract = vtk.vtkExtractCells()
    extract.SetInputData(grid)
    extract.SetCellList(kept)
    extract.Update()
    part = extract.GetOutput()
    surface = surface_of(part)

    leaves = np.unique(vtk_to_numpy(part.GetCellData().GetArray("leaf")), return_inverse=True)[1]
    cells = vtk_to_numpy(surface.GetCellData().GetArray("vtkOriginalCellIds"))
    colors = PALETTE[7 * leaves[cells] % len(PALETTE)].astype(float)
    boundary = set(centers_of(surface_of(grid)))
    is_boundary = np.array([center in boundary for center in centers_of(surface)])
    colors[is_boundary] = 0.25 * colors[is_boundary] + 0.75 * PALE
    surface.GetCellData().SetScalars(numpy_to_vtk(colors.astype(np.uint8), deep=1))
    return surface


def actor_of(data, edge_width):
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputData(data)
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    look = actor.GetProperty()
    look.EdgeVisibilityOn()
    look.SetEdgeColor(0.2, 0.2, 0.25)
    look.SetLineWidth(edge_width)
    look.SetInterpolationToFlat()
    look.SetAmbient(0.35)
    look.SetDiffuse(0.7)
    return actor


def deformed(grid):
    """Displaced by a twentieth of the model's length at most; with a scale for the stress."""
    displacement = grid.GetPointData().GetArray("displacement")
    bounds = np.array(grid.GetBounds()).reshape(3, 2)
    largest = np.linalg.norm(vtk_to_numpy(displacement), axis=1).max()
    grid.GetPointData().SetVectors(displacement)
    warp = vtk.vtkWarpVector()
    warp.SetInputData(grid)
    warp.SetScaleFactor(0.05 * np.ptp(bounds, axis=1).max() / largest)
    warp.Update()
    surface = surface_of(warp.GetOutput())
    surface.GetPointData().SetActiveScalars("von_mises")
    stresses = vtk_to_numpy(surface.GetPointData().GetArray("von_mises"))
    actor = actor_of(surface, 0.3)
    table = vtk.vtkLookupTable()
    table.SetHueRange(0.62, 0.0)
    table.SetSaturationRange(0.75, 0.85)
    table.Build()
    mapper = actor.GetMapper()
    mapper.SetLookupTable(table)
    mapper.SetScalarRange(0, np.percentile(stresses, 99.5))
    bar = vtk.vtkScalarBarActor()
    bar.SetLookupTable(table)
    bar.SetTitle("von Mises stress\n")
    bar.SetLabelFormat("%.0f")
    bar.SetNumberOfLabels(5)
    bar.SetWidth(0.08)
    bar.SetHeight(0.55)
    bar.SetPosition(0.9, 0.2)
    for text in (bar.GetTitleTextProperty(), bar.GetLabelTextProperty()):
        text.SetColor(0, 0, 0)
        text.ShadowOff()
        text.ItalicOff()
    return actor, bar


def draw(actors, out, axis, azimuth, elevation, zoom):
    renderer = vtk.vtkRenderer()
    renderer.SetBackground(1, 1, 1)
    for actor in actors:
        renderer.AddViewProp(actor)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(8)
    window.SetSize(2400, 1200)
    window.AddRenderer(renderer)
    center = np.array(actors[0].GetBounds()).reshape(3, 2).mean(axis=1)
    camera = renderer.GetActiveCamera()
    camera.SetFocalPoint(center)
    camera.SetPosition(center + np.eye(3)[axis])
    camera.SetViewUp(0, 1, 0)
    camera.Azimuth(azimuth)
    camera.Elevation(elevation)
    camera.OrthogonalizeViewUp()
    renderer.ResetCamera()
    camera.Zoom(zoom)
    window.Render()
    image = vtk.vtkWindowToImageFilter()
    image.SetInput(window)
    image.ReadFrontBufferOff()
    writer = vtk.vtkPNGWriter()
    writer.SetFileName(out)
    writer.SetInputConnection(image.GetOutputPort())
    writer.Write()


def main():
    if len(sys.argv) != 4 or sys.argv[1] not in ("cut", "result"):
        sys.exit(__doc__)
    what, file, out = sys.argv[1:]
    if what == "cut":
        draw([actor_of(cut_open(read(file)), 0.6)], out, 0, -30, 25, 1.9)
    else:
        draw(deformed(read(file)), out, 2, 20, -30, 1.6)


if __name__ == "__main__":
    main()
