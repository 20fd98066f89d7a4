"""The interactive page in headless Chromium; `make test-web` runs this, `make test` does not.

It looks like the plugin, object by object, and obeys mouse, keys and fingers.
"""

from __future__ import annotations

import colorsys
import io
import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, sync_playwright
from scipy.ndimage import binary_erosion, distance_transform_edt

import napari_unpack as nu
from napari_unpack.appearance import Decorations
from napari_unpack.geometry.view import FROM_ABOVE, Camera, View
from napari_unpack.io import save_interactive_page, save_objects_page
from napari_unpack.io.headless import packed_copy
from napari_unpack.io.interactive_page import WINDOW
from napari_unpack.rendering.compose import scene_image
from napari_unpack.rendering.scene import Scene
from napari_unpack.session.framing import fitted

NAMES = ("chromium", "chromium-browser", "google-chrome")
# Drawn by the processor, so that it needs no graphics card and is the same everywhere.
SOFTWARE = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
NASTY = "</script><script>document.title = 'broken'</script>"

HUE_TOLERANCE = 8.0
"""Degrees; 6.0 were measured. The plugin's bag is translucent, so that an object takes on some of
the hue of what lies behind it. The nearest hues of this bag are 11 degrees apart."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    path = next(filter(None, map(shutil.which, NAMES)), None)
    assert path, "install Chromium"
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=path, args=SOFTWARE)
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[nu.Session, Path]:
    bag = nu.simulate_bag(seed=1, shape=(64, 72, 96), count=10)
    session = nu.Session(bag.volume, bag.labels, bag.spacing, bag.objects)
    session.view = View(FROM_ABOVE, fov=20.0)
    session.decorations = Decorations.of((0, 0, 0, 0), ())
    session.recolor()
    session.unpack(1)
    session.rename(session.ids[0], NASTY)
    session.annotations.set_flag(session.ids[4:6], "suspicious")
    session.annotations.set_note(session.ids[5], "A rather long note: a lid, two hinges, screws")
    session.annotations.set_note(session.ids[6], "Another")
    path = tmp_path_factory.mktemp("page") / "bag.html"
    save_objects_page(session, path.with_name("table.html"), "A bag", backend="cpu")
    return session, save_interactive_page(session, path, "A bag", backend="cpu")


def opened(browser: Browser, path: Path, **settings: object) -> Page:
    asked = {"viewport": {"width": 1400, "height": 1060}, "reduced_motion": "reduce", **settings}
    page = browser.new_page(**asked)  # type: ignore[arg-type]
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on(
        "request",
        lambda r: said.append(r.url) if not r.url.startswith(("file:", "data:")) else None,
    )
    page.goto(path.as_uri())
    page.said = said  # type: ignore[attr-defined]
    return page


@pytest.fixture
def page(browser: Browser, written: tuple[nu.Session, Path]) -> Iterator[Page]:
    made = opened(browser, written[1])
    yield made
    assert made.said == []  # type: ignore[attr-defined]
    assert made.title() == "A bag"
    made.close()


def picture(page: Page) -> np.ndarray:
    """Return what the canvas shows, (H, W, 3) uint8."""
    # Two frames: one draws, and the next shows that.
    page.evaluate("() => new Promise(f => requestAnimationFrame(() => requestAnimationFrame(f)))")
    return iio.imread(io.BytesIO(page.locator("canvas").screenshot()))[..., :3]


def ground(image: np.ndarray) -> np.ndarray:
    # Corners are round and show the page.
    return image[image.shape[0] - 4, image.shape[1] // 2]


def drawn(image: np.ndarray) -> np.ndarray:
    """Return where a picture differs from its ground, but for the canvas' round corners."""
    there = np.abs(image.astype(int) - ground(image)).max(axis=-1) > 12
    there[[*range(12), *range(-12, 0)]] = False
    return there


def hue(colors: np.ndarray) -> float:
    """Return the hue of the mean of some colours, degrees."""
    return 360 * colorsys.rgb_to_hsv(*(colors.mean(axis=0) / 255))[0]


def layout(session: nu.Session) -> tuple[nu.Session, Camera]:
    """Return all unpacked in the page's window, and its camera."""
    shown = packed_copy(session)
    shown.canvas_size = WINDOW
    while len(shown.poses) < len(shown.ids):
        shown.go_to(shown.step + 1)
    return shown, fitted(shown)


def at_step(shown: nu.Session, step: int) -> Scene:
    out = {i for group in shown.steps[:step] for i in group}
    poses = {i: pose for i, pose in shown.poses.items() if i in out}
    return replace(shown.scene(), packed=frozenset(shown.poses.keys() - out), poses=poses)


def masks(scene: Scene, camera: Camera, size: tuple[int, int]) -> Iterator[tuple[int, np.ndarray]]:
    """Yield where each object is in front in the plugin's picture."""
    view = View(
        tuple(camera.direction), tuple(camera.up), tuple(camera.center), camera.height, camera.fov
    )  # fmt: skip
    first = nu.object_id_layers(
        scene.labels, scene.spacing, view, 1, size, hidden=scene.poses.keys(), backend="cpu"
    )[0]
    for i in scene.packed:
        yield i, first == i
    for i, pose in scene.poses.items():
        alone = replace(scene, packed=frozenset(), poses={i: pose})
        yield i, scene_image(alone, camera, size, None, "cpu")[..., 3] > 0.9


def test_three_steps_look_as_in_the_plugin_object_by_object(
    page: Page, written: tuple[nu.Session, Path]
) -> None:
    session, _ = written
    shown, camera = layout(session)
    last, strips, compared = len(shown.steps), [], 0
    heights = page.evaluate("JSON.parse(document.getElementById('bag').textContent).heights")
    for step in (0, last // 2, last):
        page.locator("#step").fill(str(step))
        seen = picture(page)
        size = seen.shape[:2]
        wider = max(1.0, (WINDOW[1] / WINDOW[0]) / (size[1] / size[0]))
        there = replace(camera, height=heights[step] * wider)
        scene = at_step(shown, step)
        image = scene_image(scene, there, size, None, "cpu")
        plugin = np.uint8(255 * np.clip(image[..., :3], 0, 1))
        strips.append(np.concatenate([plugin, seen], axis=0))
        covered, cast = drawn(seen), image[..., 3] > 0.1
        # Edges of the plugin's bag fade out; what stands elsewhere would share far less.
        assert (covered & cast).sum() > 0.9 * (covered | cast).sum()
        for i, mask in masks(scene, there, size):
            # The rim blends with what is beside it.
            inner = binary_erosion(mask, iterations=2)
            if inner.sum() < 60:
                continue
            apart = abs(hue(seen[inner]) - hue(plugin[inner]))
            assert min(apart, 360 - apart) < HUE_TOLERANCE, f"object {i} at step {step}"
            compared += 1
    # All are seen when all are out, and most before.
    assert compared >= 2 * len(shown.ids)
    if folder := os.environ.get("OUTPUT"):
        Path(folder).mkdir(exist_ok=True)
        iio.imwrite(Path(folder) / "web-steps.png", np.concatenate(strips, axis=1))


def middle_of(page: Page, mask: np.ndarray) -> tuple[float, float]:
    """Return the window's coordinates of a place well inside of a part of the canvas."""
    box = page.locator("canvas").bounding_box()
    assert box is not None
    row, col = np.unravel_index(int(distance_transform_edt(mask).argmax()), mask.shape)
    return box["x"] + col + 0.5, box["y"] + row + 0.5


def change(a: np.ndarray, b: np.ndarray) -> int:
    return int(np.abs(a.astype(int) - b).max())


def test_a_click_names_an_object_and_a_row_rings_it(
    page: Page, written: tuple[nu.Session, Path]
) -> None:
    session, _ = written
    shown, camera = layout(session)
    heights = page.evaluate("JSON.parse(document.getElementById('bag').textContent).heights")
    seen = picture(page)
    size = seen.shape[:2]
    wider = max(1.0, (WINDOW[1] / WINDOW[0]) / (size[1] / size[0]))
    there = replace(camera, height=heights[session.step] * wider)
    clicked = 0
    for i, mask in masks(at_step(shown, session.step), there, size):
        inner = binary_erosion(mask, iterations=4)
        if inner.sum() < 200:
            continue
        page.mouse.click(*middle_of(page, inner))
        assert page.locator("#said").inner_text().startswith(session.objects["name"][i] + ": ID")
        row = page.locator("tr[aria-current]")
        assert row.count() == 1
        assert row.get_attribute("data-id") == str(session.label_of(i))
        clicked += 1
    assert clicked >= 7
    page.keyboard.press("Escape")
    assert page.locator("tr[aria-current]").count() == 0
    np.testing.assert_array_equal(drawn(picture(page)), drawn(seen))
    # By the table's button and the keyboard alone.
    button = page.locator("tbody button").nth(2)
    button.focus()
    before = picture(page)
    page.keyboard.press("Enter")
    assert button.get_attribute("aria-pressed") == "true"
    ringed = (np.abs(picture(page).astype(int) - before).max(axis=-1) > 40).sum()
    assert 50 < ringed < 0.1 * seen[..., 0].size
    page.keyboard.press("Enter")
    np.testing.assert_array_equal(picture(page), before)


def test_the_table_sorts_and_searches(page: Page, written: tuple[nu.Session, Path]) -> None:
    session, _ = written
    volumes = session.objects["volume_mm3"].sort_values()
    page.get_by_role("columnheader").nth(3).get_by_role("button").click()
    rows = page.locator("tbody tr")
    ids = [rows.nth(k).get_attribute("data-id") for k in range(rows.count())]
    assert ids == [str(session.label_of(i)) for i in volumes.index]
    page.get_by_role("searchbox").fill("broken")
    assert page.locator("tbody tr:visible").count() == 1
    assert page.locator("tbody tr:visible button").inner_text() == NASTY
    word = "getComputedStyle(document.querySelector('tbody'), '::after').content"
    assert page.evaluate(word) == "none"
    page.get_by_role("searchbox").fill("nowhere")
    assert page.locator("tbody tr:visible").count() == 0
    assert page.evaluate(word) == '"Nothing found."'


def test_what_has_no_flag_or_note_comes_last_in_both_orders(page: Page) -> None:
    for column, said in ((5, "Flag"), (6, "Note")):
        head = page.get_by_role("columnheader", name=said)
        for _ in range(2):
            head.get_by_role("button").click()
            cells = page.locator(f"tbody td:nth-child({column})").all_inner_texts()
            assert [bool(text) for text in cells] == [True] * 2 + [False] * (len(cells) - 2)


def test_a_page_that_is_come_back_to_says_what_it_shows(
    browser: Browser, written: tuple[nu.Session, Path]
) -> None:
    page = opened(browser, written[1])
    page.get_by_role("searchbox").fill("broken")
    page.get_by_role("button", name="Unpack next").click()
    page.goto("about:blank")
    page.go_back()
    # Browsers fill in again what was typed once the page is there.
    page.wait_for_timeout(500)
    assert page.get_by_role("searchbox").input_value() == ""
    assert page.locator("#step").input_value() == "1"
    assert page.locator("#said").inner_text().startswith("Step 1 of ")
    page.close()


@pytest.mark.parametrize("width", [1024, 1400, 1920])
def test_all_columns_are_in_sight_beside_the_bag(
    browser: Browser, written: tuple[nu.Session, Path], width: int
) -> None:
    page = opened(browser, written[1], viewport={"width": width, "height": 900})
    table = page.locator(".wide").bounding_box()
    note = page.get_by_role("columnheader", name="Note").bounding_box()
    assert table
    assert note
    assert note["x"] + note["width"] <= table["x"] + table["width"]
    page.close()


# A4, upright and across, within the margins that browsers leave: CSS pixels.
@pytest.mark.parametrize("width", [717, 1047])
@pytest.mark.parametrize("name", ["bag.html", "table.html"])
def test_paper_has_all_columns_and_colours(
    browser: Browser, written: tuple[nu.Session, Path], name: str, width: int
) -> None:
    page = opened(browser, written[1].with_name(name), viewport={"width": width, "height": 1000})
    page.emulate_media(media="print")
    assert page.evaluate("document.scrollingElement.scrollWidth") <= width
    swatch = page.locator("td i").first
    assert swatch.evaluate("one => getComputedStyle(one).printColorAdjust") == "exact"
    page.close()


def test_a_title_without_blanks_is_no_wider_than_a_phone(
    browser: Browser, written: tuple[nu.Session, Path]
) -> None:
    page = opened(browser, written[1], viewport={"width": 390, "height": 844})
    page.evaluate("document.querySelector('h1').textContent = 'scan_of_a_bag_'.repeat(6)")
    assert page.evaluate("document.scrollingElement.scrollWidth") <= 390
    page.close()


def test_buttons_bar_and_keys_go_from_step_to_step(
    page: Page, written: tuple[nu.Session, Path]
) -> None:
    step, last = page.locator("#step"), layout(written[0])[0].step
    assert (step.input_value(), step.get_attribute("max")) == ("1", str(last))
    first = picture(page)
    page.get_by_role("button", name="Unpack next").click()
    assert step.input_value() == "2"
    assert page.locator("#said").inner_text().startswith(f"Step 2 of {last}: ")
    assert change(picture(page), first) > 100
    page.get_by_role("button", name="Put back").click()
    np.testing.assert_array_equal(picture(page), first)
    page.locator("canvas").focus()
    page.keyboard.press("b")
    assert step.input_value() == "0"
    assert page.get_by_role("button", name="Put back").is_disabled()
    assert page.locator("#said").inner_text() == "Everything is packed"
    for _ in range(last + 2):
        page.keyboard.press("n")
    assert step.input_value() == str(last)
    assert page.get_by_role("button", name="Unpack next").is_disabled()


def test_the_bag_turns_and_comes_near_and_what_is_out_stays(page: Page) -> None:
    box = page.locator("canvas").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    first = picture(page)
    # The first sprite stands at the window's edge, beside the bag.
    sprite = drawn(first)
    sprite[:, sprite.shape[1] // 6 : -(sprite.shape[1] // 6)] = False
    assert sprite.sum() > 200
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 90, y + 20, steps=5)
    page.mouse.up()
    turned = picture(page)
    assert change(turned, first) > 100
    np.testing.assert_array_equal(turned[sprite], first[sprite])
    assert page.locator("tr[aria-current]").count() == 0
    page.mouse.wheel(0, -300)
    page.wait_for_timeout(100)
    assert drawn(picture(page)).sum() > 1.2 * drawn(turned).sum()
    page.locator("canvas").focus()
    page.keyboard.press("0")
    np.testing.assert_array_equal(drawn(picture(page)), drawn(first))
    for key in ("ArrowLeft", "ArrowUp", "+"):
        before = picture(page)
        page.keyboard.press(key)
        assert change(picture(page), before) > 40
    page.get_by_role("button", name="Show all").click()
    np.testing.assert_array_equal(picture(page), first)


def test_two_fingers_bring_it_near_and_one_turns_it(
    browser: Browser, written: tuple[nu.Session, Path]
) -> None:
    page = opened(browser, written[1], viewport={"width": 390, "height": 844}, has_touch=True)
    # Nothing is wider than the screen but the table, which scrolls in its box.
    assert page.evaluate("document.scrollingElement.scrollWidth") <= 390
    box = page.locator("canvas").bounding_box()
    assert box is not None
    assert box["height"] < 400
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    touch = page.context.new_cdp_session(page)

    def fingers(kind: str, *apart: float) -> None:
        points = [{"x": x + a, "y": y, "id": k} for k, a in enumerate(apart)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    first = picture(page)
    fingers("touchStart", -30, 30)
    for k in range(1, 6):
        fingers("touchMove", -30 - 6 * k, 30 + 6 * k)
    fingers("touchEnd")
    assert drawn(picture(page)).sum() > 1.3 * drawn(first).sum()
    page.get_by_role("button", name="Show all").click()
    np.testing.assert_array_equal(picture(page), first)
    fingers("touchStart", 0)
    for k in range(1, 6):
        fingers("touchMove", 10 * k)
    fingers("touchEnd")
    assert change(picture(page), first) > 100
    assert page.said == []  # type: ignore[attr-defined]
    page.close()


@pytest.mark.parametrize("size", [(390, 844), (1400, 420)])
def test_a_click_on_an_object_scrolls_its_row_into_sight_and_never_the_page(
    browser: Browser, written: tuple[nu.Session, Path], size: tuple[int, int]
) -> None:
    page = opened(browser, written[1], viewport={"width": size[0], "height": size[1]})
    box = page.locator("canvas").bounding_box()
    assert box
    clicked = set()
    for share in (0.35, 0.45, 0.5, 0.55, 0.65):
        page.mouse.click(box["x"] + share * box["width"], box["y"] + box["height"] / 2)
        chosen = page.locator("tr[aria-current]")
        if not chosen.count():
            continue
        clicked.add(chosen.inner_text())
        assert page.evaluate("scrollY") == 0
        if size[0] >= 1000:
            row, table = chosen.bounding_box(), page.locator(".wide").bounding_box()
            head = page.locator("thead").bounding_box()
            assert row
            assert table
            assert head
            assert row["y"] >= head["y"] + head["height"] - 1
            assert row["y"] + row["height"] <= table["y"] + table["height"] + 1
    assert len(clicked) >= 2
    assert page.said == []  # type: ignore[attr-defined]
    page.close()


def test_objects_fly_unless_motion_is_to_be_reduced(
    browser: Browser, written: tuple[nu.Session, Path]
) -> None:
    page = opened(browser, written[1], reduced_motion="no-preference")
    first = picture(page)
    page.get_by_role("button", name="Unpack next").click()
    way = picture(page)
    page.wait_for_timeout(6000)
    there = picture(page)
    assert min(change(first, there), change(way, there), change(first, way)) > 60
    np.testing.assert_array_equal(picture(page), there)
    calm = opened(browser, written[1])
    calm.get_by_role("button", name="Unpack next").click()
    np.testing.assert_array_equal(picture(calm), there)
    page.close()
    calm.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_ground_follows_the_readers_theme(
    browser: Browser, written: tuple[nu.Session, Path], scheme: str
) -> None:
    page = opened(browser, written[1], color_scheme=scheme)
    assert (ground(picture(page)).mean() > 128) == (scheme == "light")
    page.close()


def test_without_webgl_it_says_so_and_shows_pictures(
    browser: Browser, written: tuple[nu.Session, Path]
) -> None:
    context = browser.new_context()
    context.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    page = context.new_page()
    page.goto(written[1].as_uri())
    assert page.get_by_text("does not show WebGL 2").is_visible()
    pictures = page.locator("#stills img")
    assert [one.evaluate("one => one.naturalWidth") for one in pictures.all()] == [WINDOW[1]] * 3
    assert not page.locator("canvas").is_visible()
    # The table works on.
    page.locator("tbody button").first.click()
    assert page.locator("tr[aria-current]").count() == 1
    context.close()


def test_where_the_browser_takes_the_graphics_away_it_says_so(
    browser: Browser, written: tuple[nu.Session, Path]
) -> None:
    page = opened(browser, written[1])
    page.evaluate(
        "document.querySelector('canvas').getContext('webgl2')"
        ".getExtension('WEBGL_lose_context').loseContext()"
    )
    page.get_by_text("The browser took the graphics away. Reload the page").wait_for()
    assert page.get_by_text("does not show WebGL 2").count() == 0
    assert page.locator("#stills img").first.is_visible()
    page.close()


def test_the_policy_lets_nothing_reach_the_network_and_no_other_script_run(page: Page) -> None:
    blocked = page.evaluate(
        """() => new Promise(told => {
            const seen = [];
            document.addEventListener("securitypolicyviolation", e => {
                seen.push(e.effectiveDirective);
                if (seen.length === 3) told(seen.sort());
            });
            const image = document.createElement("img");
            image.src = "http://localhost:9/a.png";
            const script = document.createElement("script");
            script.textContent = "document.title = 'broken'";
            document.body.append(image, script);
            fetch("http://localhost:9/").catch(() => {});
            setTimeout(() => told(seen.sort()), 3000);
        })"""
    )
    assert blocked == ["connect-src", "img-src", "script-src-elem"]
    # What the browser says of it is no fault of the page.
    page.said.clear()  # type: ignore[attr-defined]
