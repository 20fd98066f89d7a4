"""An object looked at alone: facts, an opacity and a cut of its own, and what is inside it."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from scipy.ndimage import gaussian_filter

from napari_unpack.appearance import TransferFunction
from napari_unpack.geometry.axes import transform_points
from napari_unpack.geometry.transforms import packed_pose, rotation_about
from napari_unpack.geometry.view import Camera
from napari_unpack.io.session_json import record_of, session_from
from napari_unpack.rendering.compose import object_image, packed_image
from napari_unpack.rendering.object_style import ObjectStyle, cut_open
from napari_unpack.session import ObjectState, Session
from napari_unpack.session.containers import open_container, parts_by_density, surrounded
from napari_unpack.session.object_facts import facts_of
from tin import tin

SPACING = (2.0, 1.0, 1.0)


@pytest.fixture
def session() -> Session:
    made = Session(*tin(), spacing=SPACING)
    made.backend = "cpu"
    return made


def test_facts_are_those_of_the_voxels(session):
    facts = facts_of(session, 1)
    assert facts.size_mm == pytest.approx((24, 20, 20))
    assert facts.volume_mm3 == 12 * 20 * 20 * 2
    mine = tin()[0][tin()[1] == 1]
    assert (facts.mean, facts.spread) == pytest.approx((mine.mean(), mine.std()), rel=1e-4)
    assert facts.neighbours == (2,)
    assert np.isnan(facts.confidence)
    assert facts_of(session, 2).spread == 0


def test_an_opacity_of_its_own_changes_the_object_alone_and_is_undone(session):
    camera, size = session.camera, (40, 50)
    pose = packed_pose(session.boxes.center(1, session.spacing), camera)

    def alone():
        return object_image(session.scene(), 1, pose, camera, size).rgba

    def bag():
        return packed_image(session.scene(), camera, size).rgba

    before, master, packed = alone(), session.transfer_function, bag()
    told = []
    session.events.states.connect(told.append)
    session.set_style(1, ObjectStyle(TransferFunction([(0, 0), (2500, 0), (2600, 0.5)])))
    assert told == [frozenset({1})]
    assert session.transfer_function is master
    assert np.abs(alone() - before).max() > 0.1
    np.testing.assert_array_equal(bag(), packed)
    session.undo()
    np.testing.assert_array_equal(alone(), before)


def test_a_cut_takes_away_what_lies_behind_its_plane(session):
    camera, size = session.camera, (60, 60)
    pose = packed_pose(session.boxes.center(2, session.spacing), camera)
    whole = object_image(session.scene(), 2, pose, camera, size)
    middle = np.asarray(session.boxes.center(2, session.spacing))
    session.set_style(2, ObjectStyle(cut=(middle, camera.right)))
    half = object_image(session.scene(), 2, pose, camera, size)
    seen = [(p.rgba[..., 3] > 0.3).sum() for p in (whole, half)]
    assert seen[1] == pytest.approx(seen[0] / 2, rel=0.15)
    # Oblique in millimetres, also where voxels are not cubes.
    point, normal = ObjectStyle(cut=(middle, np.array([0.6, 0.8, 0.0]))).planes(
        np.diag([0.5, 1.0, 1.0, 1.0])
    )[0]
    inside = middle + 3 * np.array([0.8, -0.6, 0.0])
    assert (np.array([0.5, 1, 1]) * inside - point) @ normal == pytest.approx(0, abs=1e-9)


def test_a_closed_tin_is_opened_into_its_parts_of_different_density(session):
    inner = open_container(session, 1)
    assert len(inner.ids) == 3
    sizes = sorted(int(n) for n in inner.boxes.counts)
    assert sizes == pytest.approx([216, 216, 12 * 400 - 432], rel=0.3)
    assert inner.spacing.tolist() == list(SPACING)
    assert str(inner.objects["name"].iloc[0]) == "Object 1, part 1"
    inner.backend = "cpu"
    # The wall is off what it surrounds, as if it had always been.
    assert inner.states[1] is ObjectState.UNPACKED
    assert [inner.states[i] for i in (2, 3)] == [ObjectState.PACKED] * 2
    assert inner.history.undo(inner.state) is None
    assert inner.reveal_plan(inner.ids[-1]).ids
    assert session.labels[10, 10, 10] == 1
    with pytest.raises(ValueError, match="nothing is inside Object 2"):
        open_container(session, 2)


def test_a_container_of_known_contents_is_opened_into_them():
    volume, labels = tin()
    labels[7:13, 8:14, 8:14] = 3
    table = pd.DataFrame(
        {"name": ["Tin", "Block", "Key"], "parent": [0, 0, 1]}, index=pd.Index([1, 2, 3], name="id")
    )
    inner = open_container(Session(volume, labels, SPACING, table), 1)
    assert inner.objects["name"].to_dict() == {1: "Tin", 3: "Key"}
    assert inner.states == {1: ObjectState.UNPACKED, 3: ObjectState.PACKED}


@pytest.mark.parametrize("lid", [True, False])
def test_what_stands_in_a_cup_is_its_contents_and_leaves_it_piece_by_piece(lid):
    labels = np.zeros((20, 20, 20), np.uint16)
    labels[2:18, 2:18, 2:18] = 1
    labels[4 if lid else 2 : 16, 4:16, 4:16] = 0
    labels[5:15, 5:9, 5:15], labels[5:15, 10:15, 5:15] = 4, 5
    labels[5:15, 5:15, 18:20] = 6  # beside it, not in it
    session = Session(1000.0 * (labels > 0), labels)
    assert surrounded(labels, 1) == {4, 5}
    assert surrounded(labels, 4) == set()
    turn = rotation_about((0.3, 1.0, 0.2), 0.7)
    inner = open_container(session, 1, turn)
    np.testing.assert_allclose(inner.camera.rotation, turn)
    assert inner.ids == (1, 4, 5)
    assert inner.states[1] is ObjectState.UNPACKED
    inner.direction = "+y"
    assert inner.unpack() == (5,)
    # Put back, it can be taken off again, though nothing in it is free.
    inner.restore([1])
    assert inner.unpack() == (1,)
    assert inner.states[4] is ObjectState.PACKED
    with pytest.raises(ValueError, match="is not in the bag: put it back"):
        inner.force_unpack(1)


def test_what_an_object_has_of_its_own_is_kept_in_sessions(session):
    session.set_style(
        1, ObjectStyle(TransferFunction([(0, 0), (500, 0.4)]), (np.ones(3), np.eye(3)[1]))
    )
    record = json.loads(json.dumps(record_of(session)))
    again = session_from(record, *tin())
    study = again.style(1)
    assert study.transfer_function.points == session.style(1).transfer_function.points
    np.testing.assert_array_equal(study.cut, [np.ones(3), np.eye(3)[1]])
    assert again.style(2).transfer_function is None
    del record["situation"]["studies"]
    assert session_from(record, *tin()).style(1).cut is None


def test_noise_alone_makes_no_parts():
    volume = np.random.default_rng(0).normal(1000, 20, (12, 12, 12))
    inside = np.zeros(volume.shape, bool)
    inside[2:10, 2:10, 2:10] = True
    parts = parts_by_density(volume, inside)
    assert set(np.unique(parts[~inside])) == {0}
    assert parts[inside].all()


@pytest.mark.parametrize("mirror", [1, -1])
@pytest.mark.parametrize("sheared", [False, True])
def test_the_cut_takes_what_is_nearest_on_mirrored_and_stretched_bags_too(
    session, mirror, sheared
) -> None:
    stretch = (
        np.array([[1.3, 0.4, 0.1], [0.4, 0.9, 0.2], [0.1, 0.2, 1.1]]) if sheared else np.eye(3)
    )
    stretch = mirror * stretch / np.cbrt(np.linalg.det(stretch))
    session.look(Camera.looking((0.4, 0.7, -0.3), None, session.bag.center, 50.0, 0.0, stretch))
    camera = session.camera
    point, normal = cut_open(
        session.boxes, 1, session.spacing, camera.rotation[0] @ camera.stretch, 0.3
    )
    voxels = np.argwhere(tin()[1] == 1) * SPACING
    gone = (voxels - point) @ normal < 0
    nearness = transform_points(camera.pivot_from_world(), voxels)[:, 0]
    assert 0.02 < gone.mean() < 0.5
    assert nearness[gone].min() >= nearness[~gone].max() - 1e-9


def _opened_or_not(volume: np.ndarray) -> str:
    labels = np.zeros(volume.shape, np.uint16)
    labels[4:-4, 4:-4, 4:-4] = 1
    session = Session(np.where(labels > 0, volume, 0), labels)
    try:
        return f"{len(open_container(session, 1).ids)} parts"
    except ValueError as error:
        return str(error)


def test_solid_things_have_nothing_inside_however_noisy_or_blurred_they_are() -> None:
    rng = np.random.default_rng(0)
    shape = (32, 32, 32)
    solid = np.full(shape, 1000.0)
    nothing = "nothing is inside Object 1: it is solid, or holds nothing but air"
    assert _opened_or_not(solid + rng.normal(0, 80, shape)) == nothing
    # The border blurred over into air.
    edge = np.zeros(shape)
    edge[4:-4, 4:-4, 4:-4] = 1000
    assert _opened_or_not(gaussian_filter(edge, 1.0)) == nothing
    # Folds of cloth: smooth and not very different.
    folds = 400 + 60 * gaussian_filter(rng.normal(0, 1, shape), 2.5) / 0.05
    assert _opened_or_not(folds) == nothing
    # A hollow ball holds air alone; with something in it, that is inside.
    hollow = solid.copy()
    hollow[8:24, 8:24, 8:24] = 2
    assert _opened_or_not(hollow) == nothing
    # A lighter place of its wall is not inside it.
    thin = hollow.copy()
    thin[:8, 10:22, 10:22] = 800
    assert _opened_or_not(thin) == nothing
    # What it encloses is, however little it differs.
    liquid = hollow.copy()
    liquid[8:24, 8:24, 8:24] = 800
    assert _opened_or_not(liquid) == "2 parts"
    hollow[12:20, 12:20, 12:20] = 2500
    assert _opened_or_not(hollow) == "2 parts"


def test_a_sole_beside_its_shoe_is_no_content_but_food_in_an_open_tin_is() -> None:
    shoe = np.full((32, 32, 32), 850.0)
    shoe[:, 18:] = 400
    assert "nothing is inside" in _opened_or_not(shoe)
    # Eyelets: small parts of another density that nothing surrounds.
    shoe[:, 18:] = 800
    shoe[4:8, 4:8, 4:16] = 390
    assert "nothing is inside" in _opened_or_not(shoe)
    tin = np.full((32, 32, 32), 2000.0)
    tin[8:24, 8:, 8:24] = 900
    assert _opened_or_not(tin) == "2 parts"
    # Beside each other things must differ more: a toy car has its axles.
    shoe[:, 18:] = 2600
    assert _opened_or_not(shoe) != _opened_or_not(np.full((32, 32, 32), 850.0))


def test_parents_are_told_by_the_ids_that_were_given() -> None:
    labels = np.zeros((12, 12, 12), np.int64)
    # A tray is not all around what it holds: the table alone says so.
    labels[1, 1:11, 1:11] = 2
    labels[2:4, 3:5, 3:9], labels[10] = 70000, 3
    parents = pd.DataFrame({"parent": [0, 0, 2]}, index=[2, 3, 70000])
    session = Session(labels % 97 * np.float32(50), labels, objects=parents)
    outer, other = (next(i for i in session.ids if session.label_of(i) == n) for n in (2, 3))
    assert "Object 70000" in set(open_container(session, outer).objects["name"])
    with pytest.raises(ValueError, match="nothing is inside Object 3"):
        open_container(session, other)


def opened_case(case_id: int, air: float = 0.0, padding: float = 0.0) -> Session:
    """Open a hollow case among others; three balls of other densities are one label with it."""
    z, y, x = np.indices((56, 56, 56))
    volume, labels = np.full((56, 56, 56), air, np.float32), np.zeros((56, 56, 56), np.uint16)
    case = (abs(z - 28) < 14) & (abs(y - 30) < 14) & (abs(x - 24) < 16)
    volume[case] = air + 1500
    volume[(abs(z - 28) < 12) & (abs(y - 30) < 12) & (abs(x - 24) < 14)] = air
    for k, (a, b, c, r) in enumerate([(28, 30, 16, 5), (24, 28, 30, 5), (34, 34, 30, 4)]):
        volume[(z - a) ** 2 + (y - b) ** 2 + (x - c) ** 2 < r * r] = air + 2000 + 400 * k
    for k, other in enumerate(i for i in range(1, 6) if i != case_id):
        labels[2:5, 50:53, 4 + 8 * k : 8 + 8 * k] = other
    labels[case] = case_id
    volume[(labels > 0) & ~case] = air + 1200
    # Padding is no air.
    volume[0, 0, 0] = air + padding
    session = Session(volume, labels)
    session.backend = "cpu"
    return open_container(session, case_id)


@pytest.mark.parametrize("case_id", [1, 2, 3, 4, 5])
def test_the_wall_is_off_whichever_id_the_container_has(case_id: int) -> None:
    inner = opened_case(case_id)
    largest = int(inner.boxes.ids[inner.boxes.counts.argmax()])
    out = [i for i, state in inner.states.items() if state is ObjectState.UNPACKED]
    assert out == [largest]
    assert len(inner.ids) == 4


def test_what_is_inside_looks_the_same_wherever_the_scan_has_its_zero() -> None:
    pictures = []
    for air in (0.0, -1000.0):
        inner = opened_case(1, air)
        inner.backend = "cpu"
        pictures.append(packed_image(inner.scene(), inner.camera, (60, 60)).rgba)
    assert (pictures[0][..., 3] > 0.5).sum() > 100
    np.testing.assert_allclose(pictures[1], pictures[0], atol=0.02)
    assert opened_case(1, 0.0, -2000.0).volume.min() == 0


def boxed() -> Session:
    """Return a box (1) around a pearl (2) and a brick (3), with a coin (4) beside it."""
    labels = np.zeros((24, 24, 30), np.uint16)
    labels[2:22, 2:22, 2:22] = 1
    labels[3:21, 3:21, 3:21] = 0
    labels[6:12, 6:12, 6:12], labels[13:19, 6:18, 6:18], labels[4:8, 4:8, 24:28] = 2, 3, 4
    names = pd.DataFrame({"name": ["box", "pearl", "brick", "coin"]}, index=[1, 2, 3, 4])
    made = Session(labels * np.float32(700), labels, objects=names)
    made.backend = "cpu"
    return made


def names_of(session: Session, *ids: int) -> list[str]:
    return session.objects["name"][list(ids)].tolist()


def test_what_is_opened_again_has_the_names_of_now() -> None:
    outer = boxed()
    bags = outer.opened_bags
    inner = bags.open(outer, 1)
    # Split inside, a part has an ID that another object has outside.
    assert inner.split(3, (14, 8, 8), (14, 16, 8)) == 4
    inner.rename(4, "half a brick")
    inner.rename(3, "stone")
    outer.rename(2, "gem")
    outer.rename(3, "rock")
    outer.rename(4, "penny")
    assert bags.open(outer, 1) is inner
    assert names_of(inner, 1, 2, 3, 4) == ["box", "gem", "stone", "half a brick"]
    # It is no step of undo.
    assert [step.verb for step in inner.history.done] == ["split", "rename", "rename"]
    bags.leave(outer, 1)
    assert names_of(outer, 1, 2, 3, 4) == ["box", "gem", "stone", "penny"]
    # One undo takes them back, and later names of the bag hold inside.
    outer.undo()
    assert names_of(outer, 3) == ["rock"]
    assert names_of(bags.open(outer, 1), 3) == ["rock"]
    bags.leave(outer, 1)
    assert names_of(outer, 3) == ["rock"]
    # Nor does redo inside bring back a name that the bag has taken over.
    inner.undo()
    inner.redo()
    bags.leave(outer, 1)
    assert names_of(outer, 3) == ["rock"]


def test_work_inside_outlives_repairs_elsewhere() -> None:
    outer = boxed()
    bags = outer.opened_bags
    inner = bags.open(outer, 1)
    inner.annotations.set_note(2, "from the sea")
    bags.leave(outer, 1)
    outer.delete(4)
    assert bags.worked_in(outer) == {1: inner}
    assert bags.open(outer, 1) is inner
    # What is inside is another thing then, until that is taken back.
    outer.merge([2, 3])
    assert bags.worked_in(outer) == {}
    between = bags.open(outer, 1)
    assert between is not inner
    between.hide(between.ids[-1])
    outer.undo()
    assert bags.worked_in(outer) == {1: inner}
    assert bags.open(outer, 1) is inner
    outer.redo()
    assert bags.worked_in(outer) == {1: between}
    outer.undo()
    outer.delete(1)
    assert bags.worked_in(outer) == {}


def test_voxels_around_a_container_are_compared_once_after_each_repair(monkeypatch) -> None:
    outer = boxed()
    outer.opened_bags.open(outer, 1).annotations.set_note(2, "from the sea")
    compared, equal = [], np.array_equal
    monkeypatch.setattr(
        np, "array_equal", lambda a, b: (np.ndim(a) == 3 and compared.append(1), equal(a, b))[1]
    )
    for _ in range(3):
        assert outer.opened_bags.worked_in(outer).keys() == {1}
    assert compared == []
    outer.delete(4)
    compared.clear()
    for _ in range(3):
        assert outer.opened_bags.worked_in(outer).keys() == {1}
    assert compared == [1]


def test_parts_of_one_object_share_no_names_with_the_bag(session: Session) -> None:
    inner = session.opened_bags.open(session, 1)
    inner.rename(2, "food")
    session.rename(2, "block")
    assert session.opened_bags.open(session, 1) is inner
    session.opened_bags.leave(session, 1)
    assert names_of(inner, 2) == ["food"]
    assert names_of(session, 2) == ["block"]


def test_what_was_opened_knows_what_is_inside_its_own_contents() -> None:
    labels = np.zeros((30, 30, 30), np.int64)
    labels[2:28, 2:28, 2:28] = 100001
    labels[3:27, 3:27, 3:27] = 0
    labels[6:8, 4:24, 4:24], labels[9:11, 5:20, 5:20] = 100002, 100003
    table = pd.DataFrame(
        {"name": ["box", "pouch", "coin"], "parent": [0, 100001, 100002]},
        index=[100001, 100002, 100003],
    )
    box = open_container(Session((labels > 0) * 1000.0 + 1, labels, objects=table), 1)
    names = box.objects["name"].to_dict()
    pouch = next(i for i, name in names.items() if name == "pouch")
    assert set(open_container(box, pouch).objects["name"]) == {"pouch", "coin"}


def test_what_is_inside_an_object_is_scored_by_the_model_of_the_bag() -> None:
    outer = Session(*tin())

    def model(region):
        return 0.5

    outer.use_oracle(model, dict.fromkeys(outer.ids, 0.5))
    bag = outer.opened_bags.open(outer, 1)
    assert bag.label_editor.oracle is model
    assert bag.label_editor.missing_scores_task() is not None
    # The built-in one, chosen inside.
    bag.use_oracle(None, dict.fromkeys(bag.ids, 0.1))
    outer.opened_bags.leave(outer, 1)
    assert outer.label_editor.oracle is None
    assert outer.objects["confidence"].isna().all()
    assert outer.opened_bags.open(outer, 1) is bag
    assert set(bag.objects["confidence"]) == {0.1}


def test_a_model_chosen_for_the_bag_while_an_object_is_open_stays() -> None:
    outer = Session(*tin())

    def first(region):
        return 0.5

    def second(region):
        return 0.75

    for given in (None, first):
        outer.use_oracle(given, dict.fromkeys(outer.ids, 0.5))
        bag = outer.opened_bags.open(outer, 1)
        outer.use_oracle(second, dict.fromkeys(outer.ids, 0.75))
        outer.opened_bags.leave(outer, 1)
        assert outer.label_editor.oracle is second
        assert set(outer.objects["confidence"]) == {0.75}
        # Opened once more, the inside goes by it, and one chosen there is carried out.
        assert outer.opened_bags.open(outer, 1) is bag
        assert bag.label_editor.oracle is second
        bag.use_oracle(first, dict.fromkeys(bag.ids, 0.5))
        outer.opened_bags.leave(outer, 1)
        assert outer.label_editor.oracle is first
