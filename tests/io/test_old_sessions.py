"""Sessions and an oracle saved by napari-unpack 0.1.0 (form 1) still open as they were left.

`fixtures/README.md` says how they were made. The facts beside each were written down from the
session that was saved, not from what came back.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import napari_unpack as nu
from napari_unpack.appearance import minimum_opacity

FIXTURES = Path(__file__).parent / "fixtures"
SESSIONS = ("unpacked.unpack", "repaired.unpack", "plain", "large_ids.unpack", "referring.unpack")
DIGITS = 6


class Today:
    """What is read by names that README.md does not promise: to be renamed here."""

    ids = staticmethod(lambda s: list(s.ids))
    given_id = staticmethod(lambda s, i: s.label_of(i))
    states = staticmethod(lambda s: {i: state.value for i, state in s.states.items()})
    facts = staticmethod(lambda s: s.objects)
    hues = staticmethod(lambda s: s.hues)
    steps = staticmethod(lambda s: (s.steps, s.step))
    go_to = staticmethod(lambda s, step: s.go_to(step))
    queue = staticmethod(lambda s: (s.queue.groups, s.queue.restored, s.queue.least_occluded))
    poses = staticmethod(lambda s: s.poses)
    unpack_direction = staticmethod(lambda s: s.unpack_direction)
    transfer_function = staticmethod(lambda s: s.transfer_function)
    style = staticmethod(lambda s, i: s.style(i))
    examples = staticmethod(lambda s: s.examples)
    selected = staticmethod(lambda s: s.selected)
    clipping = staticmethod(lambda s: s.clipping)
    decorations = staticmethod(lambda s: s.decorations)
    rules = staticmethod(lambda s: (s.rule, s.tolerance, s.max_group_size, s.take_least_occluded))
    look = staticmethod(
        lambda s: (s.tint_mode, s.show_unlabelled, sorted(s.locked_hues), s.hue_margin)
    )
    camera = staticmethod(lambda s: s.camera)
    window = staticmethod(lambda s: (s.canvas_size, s.seconds))
    up = staticmethod(lambda s: s.away_from_table)
    log = staticmethod(
        lambda s: [(entry.event, entry.ids, entry.packed, entry.ratio) for entry in s.log]
    )
    arrays = staticmethod(lambda s: (s.volume, s.labels, s.spacing))
    undoable = staticmethod(lambda s: len(s.history.done))


def plain(value: Any) -> Any:
    """Return a value as JSON knows it, numbers rounded."""
    if isinstance(value, dict):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if isinstance(value, float):
        return round(value, DIGITS) + 0.0 if math.isfinite(value) else None
    return value


def array_facts(array: np.ndarray) -> list[Any]:
    """Return what tells an array from all others."""
    digest = hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()
    return [array.dtype.str, list(array.shape), digest]


def style_facts(style: Any) -> Any:
    """Return an object's own opacity and cut."""
    own = style.transfer_function
    return {
        "points": None if own is None else own.points,
        "colors": None if own is None else own.colors,
        "cut": None if style.cut is None else [np.asarray(v) for v in style.cut],
    }


def facts_of(session: Any) -> dict[str, Any]:
    """Return all that can be seen of a session from outside, as JSON knows it."""
    volume, labels, spacing = Today.arrays(session)
    ids, states, table = Today.ids(session), Today.states(session), Today.facts(session)
    steps, step = Today.steps(session)
    view, camera = session.view, Today.camera(session)
    function, around = Today.transfer_function(session), Today.decorations(session)
    ground = around.background
    return plain(
        {
            "volume": array_facts(volume),
            "labels": array_facts(labels),
            "spacing": spacing,
            "ids": ids,
            "given_ids": [Today.given_id(session, i) for i in ids],
            "states": states,
            "hidden": [i for i in ids if states[i] == "hidden"],
            "unpacked": [i for group in steps[:step] for i in group],
            "steps": steps,
            "step": step,
            "queue": Today.queue(session),
            "direction": session.direction,
            "unpack_direction": Today.unpack_direction(session),
            "names": dict(table["name"].items()),
            "confidences": dict(table["confidence"].items()),
            "table": {str(name): table[name].tolist() for name in table},
            "hues": Today.hues(session),
            "transfer_function": [function.points, function.colors],
            "styles": {i: style_facts(Today.style(session, i)) for i in ids},
            "examples": sorted(Today.examples(session)),
            "selected": sorted(Today.selected(session)),
            "clipping": Today.clipping(session),
            "decorations": [ground.name, ground.colors, around.box, around.scale],
            "ground": None if ground.image is None else array_facts(ground.image),
            "rules": Today.rules(session),
            "look": Today.look(session),
            "view": [view.direction, view.up, view.center, view.height, view.fov],
            "camera": [camera.rotation, camera.center, camera.height, camera.fov, camera.stretch],
            "window": Today.window(session),
            "up": Today.up(session),
            "poses": {
                i: [pose.center, pose.rotation, pose.scale, pose.stretch]
                for i, pose in Today.poses(session).items()
            },
            "log": Today.log(session),
        }
    )


def story_of(session: Any) -> list[Any]:
    """Go on with a session; return what happens."""
    told: list[Any] = [["at step", Today.go_to(session, 1)], ["back", Today.states(session)]]
    told.append(["at step", Today.go_to(session, 3)])
    for n in (1, 2):
        try:
            told += [["unpackable", session.unpackable()], ["left", session.unpack(n)]]
        except ValueError:
            told.append(["left", "nobody"])
    told += [["returned", session.restore(1)], ["end", Today.states(session)]]
    told.append(["poses", sorted(Today.poses(session))])
    return plain(told)


def expected(name: str) -> dict[str, Any]:
    return json.loads((FIXTURES / f"expected_{name.removesuffix('.unpack')}.json").read_text())


def members(path: Path) -> dict[str, bytes]:
    if path.is_dir():
        return {file.name: file.read_bytes() for file in path.iterdir()}
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def picture(data: bytes) -> np.ndarray:
    import imageio.v3 as iio

    return np.asarray(iio.imread(io.BytesIO(data), extension=".png")).astype(int)


@pytest.mark.parametrize("name", SESSIONS)
def test_an_old_session_opens_as_it_was_left(name):
    told, session = expected(name)["facts"], nu.open_session(FIXTURES / name)
    found = facts_of(session)
    assert found.keys() == told.keys()
    for key in told:
        if key == "poses":
            # How they are held; where the slots are is planned for the window of today.
            held = [{i: pose[1::2] for i, pose in each[key].items()} for each in (found, told)]
            assert flat(held[0]) == pytest.approx(flat(held[1]), abs=1e-4)
        elif key == "camera":
            assert flat(found[key]) == pytest.approx(flat(told[key]), abs=1e-4), key
        else:
            assert found[key] == told[key], key
    assert Today.undoable(session) == 0


@pytest.mark.parametrize("name", SESSIONS)
def test_an_old_session_goes_on_as_it_would_have_then(name):
    told, found = expected(name)["story"], story_of(nu.open_session(FIXTURES / name))
    assert found == told


@pytest.mark.parametrize("name", SESSIONS)
def test_an_old_session_saved_again_says_and_shows_the_same(name, tmp_path, monkeypatch):
    # The air around an object that is hardly seen was raised with it then.
    monkeypatch.setattr(minimum_opacity, "own_range", lambda *_: None)
    session = nu.open_session(FIXTURES / name)
    before = members(FIXTURES / name)
    after = members(nu.save_session(session, tmp_path / "again.unpack"))
    old, new = (json.loads(parts["session.json"])["session"] for parts in (before, after))
    assert lost(old, new, "session") == []
    shown, shows = picture(before["picture.png"]), picture(after["picture.png"])
    assert shown.shape == shows.shape
    # Of the bag, inside its sphere: where the slots are is planned for the window of today.
    row, col = session.camera.project(session.bag.center, shown.shape[:2])
    rows, cols = np.indices(shown.shape[:2])
    pixels = session.bag.radius_in(session.camera.stretch) * len(shown) / session.camera.height
    inside = np.hypot(rows - row, cols - col) < pixels
    # Another processor may round another way, and a ray at an edge meet something else.
    assert (np.abs(shown - shows).max(axis=2) > 2)[inside].mean() < 0.002


def lost(old: Any, new: Any, where: str) -> list[str]:
    """Return what an old record says and a new one does not; the new one may say more."""
    if isinstance(old, dict) and isinstance(new, dict):
        gone = [f"{where}.{key} is gone" for key in old.keys() - new.keys()]
        kept = sorted(old.keys() & new.keys())
        return gone + [line for key in kept for line in lost(old[key], new[key], f"{where}.{key}")]
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        pairs = zip(old, new, strict=True)
        return [line for k, (a, b) in enumerate(pairs) for line in lost(a, b, f"{where}[{k}]")]
    return [] if old == new else [f"{where} was {old}, is {new}"]


def flat(value: Any) -> list[Any]:
    """Return the numbers in nested lists and dictionaries, keys among them, in order."""
    if isinstance(value, dict):
        return [n for key in sorted(value) for n in (int(key), *flat(value[key]))]
    return [n for part in value for n in flat(part)] if isinstance(value, list) else [value]


def rows_about(oracle: Any) -> np.ndarray:
    """Return feature rows around those an oracle was trained on, (30, F)."""
    count = len(oracle.center)
    steps = np.sin(np.arange(30 * count).reshape(30, count))
    return oracle.center + np.linspace(0, 6, 30)[:, None] * steps * oracle.scale


@pytest.mark.parametrize("name", ["oracle.npz", "oracle_of_good_alone.npz"])
def test_an_old_oracle_is_as_sure_as_it_was(name, tmp_path):
    told = json.loads((FIXTURES / f"expected_{name.removesuffix('.npz')}.json").read_text())
    oracle = nu.Oracle.load(FIXTURES / name)
    assert (oracle.bad is None) == (told["bad"] is False)
    confidences = oracle.scores(rows_about(oracle))
    assert confidences.tolist() == pytest.approx(told["confidences"], abs=1e-6)
    assert 0.0 < min(told["confidences"]) < 0.5 < max(told["confidences"])
    oracle.save(tmp_path / name)
    with np.load(FIXTURES / name) as old, np.load(tmp_path / name) as new:
        assert set(old.files) <= set(new.files)
        for part in old.files:
            np.testing.assert_array_equal(new[part], old[part], part)
