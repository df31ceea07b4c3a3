"""COLLADA files that state a unit or an axis of their own: refused, since nothing here applies them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robots.errors import SetupError
from robots.geometry import read_mesh, read_triangles

TEXT = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>{asset}</asset>
<library_geometries><geometry id="g"><mesh><source id="p">
<float_array id="a" count="9">0 0 0 1 0 0 0 1 2</float_array>
<technique_common><accessor source="#a" count="3" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles></mesh>
</geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node id="n">
<instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""


def written(path: Path, asset: str) -> Path:
    path.write_text(TEXT.format(asset=asset), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "asset", ["", '<unit meter="1"/>', '<unit name="meter" meter="1.0"/><up_axis>Z_UP</up_axis>']
)
def test_metres_with_z_up_are_read_as_they_stand(tmp_path: Path, asset: str) -> None:
    found = read_mesh(written(tmp_path / "a.dae", asset))
    np.testing.assert_array_equal(found[:, :3].max(axis=0), [1.0, 1.0, 2.0])


@pytest.mark.parametrize(
    ("asset", "told"),
    [
        ('<unit meter="0.001" name="millimeter"/>', "its <unit> is '0.001' m, .*export it in metres"),
        ("<unit name='inch' meter = '0.0254'/>", "its <unit> is '0.0254' m"),
        ('<unit meter="x"/>', "its <unit> is 'x' m"),
        ("<up_axis>Y_UP</up_axis>", "its up_axis is 'Y_UP', .*export it with Z_UP"),
        ('<unit meter="1"/><up_axis> X_UP </up_axis>', "its up_axis is 'X_UP'"),
    ],
)
@pytest.mark.parametrize("read", [read_mesh, read_triangles])
@pytest.mark.parametrize("name", ["a.dae", "A.DAE"])
def test_another_unit_or_axis_is_refused(
    tmp_path: Path, asset: str, told: str, read: object, name: str
) -> None:
    with pytest.raises(SetupError, match=rf"{name}: {told}"):
        read(written(tmp_path / name, asset))
