"""VTK's ray caster for the CPU, on the same volume, view and transfer function."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.scenes import Scenes
from napari_unpack.geometry.axes import flip


def vtk_frame(scenes: Scenes) -> Callable[[], Any]:
    """Return a function that casts one frame; raise `ImportError` without VTK.

    Notes
    -----
    vtkFixedPointVolumeRayCastMapper with all cores, composite blending, shading, one sample a
    voxel, one ray a pixel, its own empty-space skipping. It knows no labels, so it has less to
    do than we. Its axes x, y, z are right-handed where ours are in z, y, x, so its picture is the
    mirror image: the same rays all the same. The camera is nudged from frame to frame, else VTK
    would reuse the last one.
    """
    import vtk
    from vtkmodules.util.numpy_support import numpy_to_vtk

    vtk.vtkObject.GlobalWarningDisplayOff()
    volume, camera, size = scenes.packing.volume, scenes.camera, scenes.canvas
    image = vtk.vtkImageData()
    image.SetDimensions(*volume.shape[::-1])
    scalars = numpy_to_vtk(volume.ravel(), deep=False)
    image.GetPointData().SetScalars(scalars)

    mapper = vtk.vtkFixedPointVolumeRayCastMapper()
    mapper.SetInputData(image)
    mapper.SetAutoAdjustSampleDistances(0)
    mapper.SetImageSampleDistance(1.0)
    mapper.SetSampleDistance(1.0)
    mapper.SetInteractiveSampleDistance(1.0)

    opacity, color = vtk.vtkPiecewiseFunction(), vtk.vtkColorTransferFunction()
    for density, value in scenes.transfer_function.points:
        opacity.AddPoint(density, value)
    color.AddRGBPoint(0, 1, 1, 1)
    look = vtk.vtkVolumeProperty()
    look.SetScalarOpacity(opacity)
    look.SetColor(color)
    look.SetInterpolationTypeToLinear()
    look.ShadeOn()
    look.SetScalarOpacityUnitDistance(1.0)
    actor = vtk.vtkVolume()
    actor.SetMapper(mapper)
    actor.SetProperty(look)

    renderer, window = vtk.vtkRenderer(), vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetSize(size[1], size[0])
    window.AddRenderer(renderer)
    renderer.AddVolume(actor)
    eye = renderer.GetActiveCamera()
    eye.ParallelProjectionOn()
    eye.SetParallelScale(camera.height / 2)
    eye.SetFocalPoint(*flip(camera.center))
    eye.SetPosition(*flip(camera.center - camera.direction * 2000))
    eye.SetViewUp(*flip(camera.up))
    renderer.ResetCameraClippingRange()
    nudges = np.random.default_rng(0)

    def frame() -> Any:
        eye.Azimuth(float(nudges.uniform(0.02, 0.05)))
        window.Render()
        return window, scalars

    return frame
