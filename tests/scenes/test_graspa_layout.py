"""Layouts of the GRASPA benchmark: where their objects stand, and which files are refused."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
import trimesh

from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.scenes.graspa_layout import MIDDLE_MM, SHIFTS_MM, LayoutSource, read_layout
from verefine_viz.scenes.source import open_scene

OBJECT = """
  <ManipulationObject name='{name}'>
    <GlobalPose><Transform><Matrix4x4>
      <row1 c1='{a[0]}' c2='{a[1]}' c3='{a[2]}' c4='{t[0]}'/>
      <row2 c1='{b[0]}' c2='{b[1]}' c3='{b[2]}' c4='{t[1]}'/>
      <row3 c1='{c[0]}' c2='{c[1]}' c3='{c[2]}' c4='{t[2]}'/>
      <row4 c1='0' c2='0' c3='0' c4='1'/>
    </Matrix4x4></Transform></GlobalPose>
  </ManipulationObject>"""
QUARTER = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
HALVES_MM = (25.0, 39.0, 25.5)


def _layout(folder: Path, name: str = "YcbFoamBrick", rotation: object = QUARTER, more: str = "") -> Path:
    a, b, c = np.array(rotation).tolist()
    one = OBJECT.format(name=name, a=a, b=b, c=c, t=(-200.0, 150.0, -2.0))
    table = "<Obstacle name='Table'><Matrix4x4><row1 c1='0='/></Matrix4x4></Obstacle>"
    file = folder / "layout.xml"
    file.write_text(f"<Scene name='Layout'>{one}{more}{table}</Scene>")
    return file


@pytest.fixture
def models(tmp_path: Path) -> Path:
    folder = tmp_path / "models"
    folder.mkdir()
    trimesh.creation.box(2 * np.array(HALVES_MM)).export(folder / "obj_000021.ply")
    return folder


def _opened(layout: Path, models: Path, **scene: object) -> LayoutSource:
    settings = msgspec.convert(
        {"source": "layout", "layout": str(layout), "dataset": str(models), **scene}, SceneSettings
    )
    source = open_scene(settings, HypothesesSettings())
    assert isinstance(source, LayoutSource)
    return source


@pytest.mark.parametrize("is_turned", [False, True])
def test_an_object_stands_where_the_layout_has_it(tmp_path: Path, models: Path, is_turned: bool) -> None:
    problem = _opened(_layout(tmp_path), models, turned=is_turned).problem("0/1")
    (brick,) = problem.instances
    _, _, shift_mm = SHIFTS_MM["YcbFoamBrick"]
    # A quarter turn takes the shift (x, y) to (-y, x).
    x_mm, y_mm = -200.0 - shift_mm[1] - MIDDLE_MM[0], 150.0 + shift_mm[0] - MIDDLE_MM[1]
    T_table_cam = problem.observation.T_map_cam
    T = T_table_cam @ brick.T_cam_obj_gt
    np.testing.assert_allclose(1e3 * T[:3, 3], [x_mm, y_mm, HALVES_MM[2]], atol=1.0)
    expected = np.array(QUARTER) @ np.diag([-1.0, -1.0, 1.0]) if is_turned else np.array(QUARTER)
    np.testing.assert_allclose(T[:3, :3], expected, atol=0.01)
    assert problem.models[21].name == "foam_brick"


def test_objects_without_a_model_are_left_out(tmp_path: Path, models: Path) -> None:
    more = "".join(
        OBJECT.format(name=name, a=QUARTER[0], b=QUARTER[1], c=QUARTER[2], t=(0.0, 0.0, 0.0))
        for name in ("YcbPear", "YcbBanana")
    )
    source = _opened(_layout(tmp_path, more=more), models)
    assert [i.obj_id for i in source.problem("0/0").instances] == [21]
    (note,) = source.notes
    assert "YcbPear, YcbBanana" in note


def test_what_is_wrong_in_a_layout_or_missing_is_named(tmp_path: Path, models: Path) -> None:
    layout = _layout(tmp_path)
    with pytest.raises(VerefineError, match=r"available: 21 \(foam_brick\)"):
        _opened(layout, models, objects=[3])
    with pytest.raises(VerefineError, match=r"scene\.layout"):
        open_scene(SceneSettings(source="layout", dataset=str(models)), HypothesesSettings())
    for rotation, message in ((np.diag([1.0, 1.0, -1.0]), "not rigid"), (np.full((3, 3), np.nan), "finite")):
        with pytest.raises(InputError, match=f"Matrix4x4.*{message}"):
            read_layout(_layout(tmp_path, rotation=rotation))
    with pytest.raises(VerefineError, match="YcbPear"):
        _opened(_layout(tmp_path, "YcbPear"), models)
    for content, message in (("banana", "XML"), ("<Scene/>", "0 ManipulationObject")):
        layout.write_text(content)
        with pytest.raises(InputError, match=message):
            _opened(layout, models)


@pytest.mark.usefixtures("long_run", "processes")
def test_the_objects_of_layout_0_lie_as_the_layout_has_them(shared_data: Path) -> None:
    """Upright ones within 3° and 6 mm; all are seen."""
    layout = shared_data / "grasps/graspa_layouts/layout_0.xml"
    problem = _opened(layout, shared_data / "ycbv/models_textured").problem("0/0")
    names = [problem.models[i.obj_id].name for i in problem.instances]
    assert names == ["banana", "mustard_bottle", "potted_meat_can", "gelatin_box", "foam_brick"]
    for i, o in list(zip(problem.instances, read_layout(layout)[0], strict=True))[1:]:
        assert i.visib_fract > 0.95
        T, middle_m = problem.observation.T_map_cam @ i.T_cam_obj_gt, np.array(SHIFTS_MM[o.name][2]) * 1e-3
        xy_m = (o.T_board_scan @ np.append(middle_m, 1.0))[:2] - np.array(MIDDLE_MM) * 1e-3
        np.testing.assert_allclose(T[:2, 3], xy_m, atol=0.006)
        np.testing.assert_allclose(T[2, :3], o.T_board_scan[2, :3], atol=0.05)
