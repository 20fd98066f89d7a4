"""Many scans on real clusters: one of this machine, and a plain scheduler with workers."""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import shutil
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path
from threading import Thread
from time import monotonic, sleep
from typing import Any

import numpy as np
import pandas as pd
import pytest
from dask_pair import Pair, make_bag
from typer.testing import CliRunner

import napari_unpack as nu
from napari_unpack import atomic
from napari_unpack.batches import cluster
from napari_unpack.batches.inputs import find_inputs
from napari_unpack.batches.results import ScanResult, results_in, session_in
from napari_unpack.batches.run_settings import Settings, identity_of_settings
from napari_unpack.batches.scan_work import Place, work_on
from napari_unpack.cli import app
from napari_unpack.io import load_labels, load_volume

distributed = pytest.importorskip("distributed")
QUICK: dict[str, Any] = {"pictures": False}


def run(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def first(bags: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """A run as a newcomer begins it: inputs and a folder, nothing else."""
    output = tmp_path_factory.mktemp("run") / "results"
    return output, run("batch", bags, "--output", output, "--json")


def test_a_newcomers_run_ends_with_all_that_was_promised(first: tuple[Path, Any]) -> None:
    output, told = first
    # Some succeeded, not all.
    assert told.exit_code == 3, told.output
    lines = {one["scan"]: one for one in map(json.loads, told.stdout.splitlines())}
    assert {name: one["status"] for name, one in lines.items()} == {
        "a": "done",
        "b": "done",
        "c": "done",
        "broken": "failed",
    }
    assert "not a readable .npz" in lines["broken"]["reason"]
    assert "3 of 4 scans done" in told.stderr
    for one in (lines["a"], lines["b"], lines["c"]):
        folder = output / one["folder"]
        assert {"picture.png", "objects.html"} <= {file.name for file in folder.iterdir()}
        session = nu.open_session(session_in(folder))
        # Packed, with the whole way out known.
        assert session.step == 0
        assert {i for group in session.steps for i in group} == set(session.ids)
        assert np.array_equal(load_labels(folder / "labels.npz")[0], session.labels)
    # What is not sure was found, and can be reviewed.
    assert nu.open_session(output / lines["b"]["folder"] / "session.unpack").review.evidence
    page = (output / "index.html").read_text("utf-8")
    assert page.count("<tr><td") == 4
    assert f'href="{lines["a"]["folder"]}/objects.html"' in page


def test_one_table_holds_all_objects_of_the_run(first: tuple[Path, Any]) -> None:
    output, _ = first
    objects, scans = (pd.read_parquet(output / f"{n}.parquet") for n in ("objects", "scans"))
    assert Counter(objects["scan"]) == {"a": 3, "b": 3, "c": 3}
    of_a = objects[objects["scan"] == "a"].set_index("id")
    assert of_a["voxels"].tolist() == [16 * 16 * 10] * 3
    assert of_a.loc[1, ["long_mm", "middle_mm", "short_mm"]].tolist() == pytest.approx([16, 16, 10])
    assert sorted(of_a["order"]) == [1, 2, 3]
    # They leave towards the viewer, who looks along the row from above.
    assert [list(ids) for ids in of_a["blocked_by"]] == [[], [1], [2]]
    assert objects[objects["scan"] == "b"]["confidence"].between(0, 1).all()
    assert scans.set_index("scan")["status"]["broken"] == "failed"


def test_started_again_it_makes_only_what_is_new_whatever_it_is_called(
    first: tuple[Path, Any], bags: Path, client: Any, tmp_path: Path
) -> None:
    output, _ = first
    before = {one.scan: (output / one.folder / "done.json").stat() for one in results_in(output)}
    # The same content under another name and of another time; and one that is new.
    shutil.copy(bags / "a.npz", tmp_path / "renamed.npz")
    make_bag(tmp_path / "d.npz", 3)
    again = nu.batch([bags / "b.npz", tmp_path], output, client)
    assert {one.scan: one.status for one in again.results} == {
        "b": "kept",
        "renamed": "kept",
        "d": "done",
    }
    assert not again.failed
    after = {one.scan: (output / one.folder / "done.json").stat() for one in results_in(output)}
    assert {name: after[name] for name in before} == before
    # Scans of earlier calls stay in the table, each once.
    assert Counter(again.objects["scan"]) == {"a": 3, "b": 3, "c": 3, "d": 3, "renamed": 3}
    # A file that was moved is no second scan.
    (tmp_path / "d.npz").rename(tmp_path / "moved.npz")
    again = nu.batch(tmp_path, output, client)
    assert Counter(again.objects["scan"]) == {"a": 3, "b": 3, "c": 3, "moved": 3, "renamed": 3}


def test_a_killed_workers_scan_is_done_elsewhere_and_nothing_twice(
    pair: Pair, client: Any, tmp_path: Path
) -> None:
    inputs = [make_bag(tmp_path / f"{n}.npz", n) for n in range(6)]
    told: list[ScanResult] = []
    work = Thread(
        target=lambda: nu.batch(
            inputs, tmp_path / "out", client, told=lambda one, *_: told.append(one), **QUICK
        )
    )
    victim = pair.processes[1]
    work.start()
    end, mine = monotonic() + 20, ()
    while not mine and monotonic() < end:
        sleep(0.002)
        info = client.scheduler_info(n_workers=-1)["workers"]
        busy = {w: keys for w, keys in client.processing().items() if keys}
        pids = client.run(lambda: __import__("os").getpid(), workers=list(busy)) if busy else {}
        mine = [w for w, pid in pids.items() if pid == victim.pid and w in info]
    victim.kill()
    work.join(30)
    assert mine, "it was at work"
    assert sorted(one.scan for one in told) == [str(n) for n in range(6)]
    assert {one.status for one in told} == {"done"}
    assert len(list((tmp_path / "out" / "scans").glob("[!.]*"))) == 6
    pair.worker()
    client.wait_for_workers(2, timeout=20)


def test_a_worker_of_another_version_or_without_the_package_is_refused(
    pair: Pair, client: Any, bags: Path, tmp_path: Path
) -> None:
    about = tmp_path / "old" / "napari_unpack-0.0.1.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: napari-unpack\nVersion: 0.0.1\n")
    bare = tmp_path / "bare"
    bare.mkdir()
    (bare / "sitecustomize.py").write_text(
        "import importlib.metadata as m\n"
        "find = m.version\n"
        "def version(name):\n"
        "    if name == 'napari-unpack':\n"
        "        raise m.PackageNotFoundError(name)\n"
        "    return find(name)\n"
        "m.version = version\n"
    )
    for path, sentence in ((about.parent, "has napari-unpack 0.0.1"), (bare, "no napari-unpack")):
        strange = pair.worker(path)
        client.wait_for_workers(3, timeout=20)
        with pytest.raises(ValueError, match=sentence):
            nu.batch(bags / "a.npz", tmp_path / "out", client, **QUICK)
        strange.kill()
        while len(client.scheduler_info(n_workers=-1)["workers"]) > 2:
            sleep(0.02)


def test_a_run_that_cannot_begin_leaves_the_folder_as_it_is_force_or_not(
    pair: Pair, client: Any, bags: Path, tmp_path: Path
) -> None:
    output = tmp_path / "out"
    nu.batch(bags / "a.npz", output, client, **QUICK)
    before = {file: file.read_bytes() for file in output.rglob("*") if file.is_file()}
    about = tmp_path / "old" / "napari_unpack-0.0.1.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: napari-unpack\nVersion: 0.0.1\n")
    strange = pair.worker(about.parent)
    client.wait_for_workers(3, timeout=20)
    for folder in (output, tmp_path / "new"):
        with pytest.raises(ValueError, match=r"has napari-unpack 0.0.1"):
            nu.batch(bags / "a.npz", folder, client, smallest=9.0, force=True, **QUICK)
    strange.kill()
    while len(client.scheduler_info(n_workers=-1)["workers"]) > 2:
        sleep(0.02)
    assert {file: file.read_bytes() for file in output.rglob("*") if file.is_file()} == before
    assert not (tmp_path / "new").exists()


def test_a_worker_that_sees_another_folder_is_told_and_the_folder_is_not_claimed(
    tmp_path: Path,
) -> None:
    """As on two machines that share no disk: what one writes the other does not find."""
    output = tmp_path / "out"

    class Elsewhere:
        def __init__(self) -> None:
            self.asked: list[str] = []

        def wait_for_workers(self, count: int) -> None: ...

        def run(self, function: Any, *given: str, **_: Any) -> dict[str, Any]:
            if not given:
                return {"tcp://far": function()}
            assert function(*given), "here it is"
            self.asked += given
            return {"tcp://far": False}

    far = Elsewhere()
    with pytest.raises(ValueError, match=r"far does not see .*out: choose a folder that all"):
        cluster.check_workers(far, output)
    assert [Path(file).parent for file in far.asked] == [output]
    assert not any(output.iterdir())


def test_sizes_that_mean_nothing_are_refused_before_the_folder_is_claimed(
    bags: Path, tmp_path: Path
) -> None:
    for smallest in ("nan", "-1", "inf"):
        told = run("batch", bags, "--output", tmp_path / "out", "--smallest", smallest)
        assert told.exit_code == 1
        assert "smallest must be a volume in mm^3 of 0 or more" in told.stderr
    assert not (tmp_path / "out").exists()


def test_an_unreachable_scheduler_is_told_in_a_sentence(
    bags: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "CONNECT_SECONDS", 0.3)
    address = "tcp://127.0.0.1:9"
    told = run("batch", bags, "--output", tmp_path / "out", "--scheduler", address)
    assert told.exit_code == 1
    assert told.stderr.startswith(f"error: no Dask scheduler answers at {address}")
    assert not (tmp_path / "out").exists()


def test_another_runs_folder_is_left_alone_without_force(
    bags: Path, client: Any, tmp_path: Path
) -> None:
    output = tmp_path / "out"
    nu.batch(bags / "a.npz", output, client, **QUICK)
    with pytest.raises(
        ValueError, match=r"other settings \(smallest not given there and 9.0 now\)"
    ):
        nu.batch(bags / "a.npz", output, client, smallest=9.0, **QUICK)
    (before,) = results_in(output)
    forced = nu.batch(bags / "a.npz", output, client, smallest=9.0, force=True, **QUICK)
    assert forced.results[0].status == "done"
    # Replaced, and not beside it.
    assert [one.identity for one in results_in(output)] == [forced.results[0].identity]
    assert before.identity != forced.results[0].identity
    (tmp_path / "else").mkdir()
    (tmp_path / "else" / "letter.txt").write_text("mine")
    with pytest.raises(ValueError, match="holds something else"):
        nu.batch(bags / "a.npz", tmp_path / "else", client)
    with pytest.raises(ValueError, match="is a file"):
        nu.batch(bags / "a.npz", tmp_path / "else" / "letter.txt", client)


@pytest.mark.skipif(os.name != "posix", reason="signals of a terminal")
def test_ctrl_c_ends_a_run_in_a_sentence(bags: Path, tmp_path: Path) -> None:
    begin = [sys.executable, "-c", "from napari_unpack.cli import main; main()"]
    words = [*begin, "batch", str(bags), "--output", "out"]
    more = ["--workers", "1", "--no-pictures"]
    # As a terminal does it: a group of processes that gets the signal as a whole.
    run = subprocess.Popen(
        [*words, *more],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Tests that were begun in the background inherit that the signal is ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert run.stderr is not None
    said = iter(run.stderr.readline, "")
    assert any(line.startswith("1 of 4 scans") for line in said)
    os.killpg(run.pid, signal.SIGINT)
    rest = run.communicate(timeout=60)[1]
    assert run.returncode not in (0, 3, 4), rest
    assert "stopped: what is done is kept" in rest
    assert "Traceback" not in rest


def test_a_full_disk_is_told_before_and_while_it_fills(
    bags: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = shutil.disk_usage(tmp_path)._replace(free=100)
    monkeypatch.setattr(atomic.shutil, "disk_usage", lambda _: full)
    with pytest.raises(OSError, match="free some, or choose another folder"):
        nu.batch(bags / "a.npz", tmp_path / "out", client=object())
    assert not (tmp_path / "out").exists()
    (tmp_path / "scans").mkdir()
    result = work_on(find_inputs([bags / "a.npz"])[0], Place(tmp_path, Settings()), {})
    assert (result.status, list((tmp_path / "scans").iterdir())) == ("failed", [])
    assert "free some, or choose another folder" in result.reason


def test_a_scan_too_big_for_a_worker_says_so(bags: Path, tmp_path: Path) -> None:
    place = Place(tmp_path, Settings(), memory=500_000_000)
    result = work_on(find_inputs([bags / "a.npz"])[0], place, {})
    assert "takes about 0.7 GB, and a worker has 0.5 GB" in result.reason


def test_a_voxel_size_of_the_table_is_not_told_as_assumed(bags: Path, tmp_path: Path) -> None:
    bag = load_volume(bags / "a.npz")
    for name, array in (("v", bag.volume), ("l", bag.labels)):
        np.save(tmp_path / f"{name}.npy", array)
    place, table = Place(tmp_path, Settings(pictures=False)), tmp_path / "list.csv"
    (tmp_path / "scans").mkdir()
    for size, notes in (("", ("it gives no voxel size: 1 mm was assumed",)), ("2 1 0.5", ())):
        table.write_text(f"volume,labels,spacing\nv.npy,l.npy,{size}\n")
        result = work_on(find_inputs([table])[0], place, {})
        assert (result.status, result.notes) == ("done", notes)
        session = nu.open_session(tmp_path / result.folder / "session.unpack")
        assert (session.assumed, tuple(session.spacing)) == (
            notes,
            (2, 1, 0.5) if size else (1,) * 3,
        )


def test_a_name_too_long_is_a_row_with_its_reason(bags: Path, client: Any, tmp_path: Path) -> None:
    table = tmp_path / "list.csv"
    table.write_text(f"volume,name\n{bags / 'a.npz'},short\n{'x' * 300}.npz,long\n")
    # A link to such a name is one that leads nowhere.
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "link.npz").symlink_to("x" * 300)
    shutil.copy(bags / "c.npz", tmp_path / "in")
    report = nu.batch([table, tmp_path / "in"], tmp_path / "out", client, **QUICK)
    assert {one.scan: one.status for one in report.results} == {
        "short": "done",
        "long": "failed",
        "c": "done",
    }
    assert "File name too long" in report.failed[0].reason


def test_workers_fit_cores_scans_and_memory(bags: Path) -> None:
    scans = find_inputs([bags])
    assert cluster.workers_that_fit(scans, 16, 10**12) == 4
    assert cluster.workers_that_fit(scans, 2, 10**12) == 2
    assert cluster.workers_that_fit(scans, 16, 2 * 10**9) == 2
    assert cluster.workers_that_fit(scans, 16, 10**6) == 4


def test_what_a_call_is_given_counts(bags: Path, client: Any, tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="give settings or pictures, not both"):
        nu.batch(bags / "a.npz", tmp_path / "out", client, settings=Settings(), **QUICK)


def test_the_threads_of_a_run_are_those_it_was_given_and_no_later_runs(
    bags: Path, client: Any, tmp_path: Path
) -> None:
    setting, seen = "NAPARI_UNPACK_THREADS", list[set[Any]]()

    def look(*_: object) -> None:
        seen.append(set(client.run(os.getenv, setting).values()))

    for n in (3, 2):
        nu.batch(bags / "a.npz", tmp_path / str(n), client, threads=n, told=look, **QUICK)
    look()
    assert seen == [{"3"}, {"2"}, {None}]


@pytest.mark.parametrize("own", [None, "2"])
def test_workers_in_the_callers_process_leave_its_own_threads(
    bags: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, own: str | None
) -> None:
    distributed = importlib.import_module("distributed")
    setting, seen = "NAPARI_UNPACK_THREADS", list[str | None]()
    if own is None:
        monkeypatch.delenv(setting, raising=False)
    else:
        monkeypatch.setenv(setting, own)
    here = {"processes": False, "n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0"}
    with distributed.Client(**here) as client:
        for n in (4, 3):
            report = nu.batch(
                bags / "a.npz",
                tmp_path / str(n),
                client,
                threads=n,
                told=lambda *_: seen.append(os.getenv(setting)),
                **QUICK,
            )
            assert not report.failed
            seen.append(os.getenv(setting))
    assert seen == ["4", own, "3", own]


def test_two_rows_of_one_volume_are_both_kept_when_done_anew(
    bags: Path, client: Any, tmp_path: Path
) -> None:
    volume = load_volume(bags / "a.npz").volume
    for k, level in enumerate((1, 2)):
        labels = np.where(volume > np.quantile(volume, 0.9), level, 0).astype(np.uint16)
        np.savez(tmp_path / f"l{k}.npz", labels=labels)
    table, output = tmp_path / "two.csv", tmp_path / "out"
    table.write_text(
        f"volume,labels,name\n{bags / 'a.npz'},l0.npz,first\n{bags / 'a.npz'},l1.npz,second\n"
    )
    for force, status in ((False, "done"), (True, "kept")):
        done = nu.batch(table, output, client, force=force, **QUICK)
        assert [one.status for one in done.results] == [status, status]
        assert sorted(one.scan for one in results_in(output)) == ["first", "second"]


def test_tables_and_open_know_what_a_file_holds_and_is_called_now(
    client: Any, tmp_path: Path
) -> None:
    scans, output = tmp_path / "in", tmp_path / "out"
    scans.mkdir()
    file, other = make_bag(scans / "a.npz", 0), make_bag(scans / "b.npz", 1)
    (first, _) = nu.batch(scans, output, client, **QUICK).results
    # Other content: what was found before is kept, and is no scan of the file that is there.
    old, new = file.read_bytes(), make_bag(tmp_path / "c.npz", 2).read_bytes()
    file.write_bytes(new)
    (second, _) = nu.batch(scans, output, client, **QUICK).results
    for content, now in ((new, second), (old, first)):
        file.write_bytes(content)
        for asked in (file, other):
            report = nu.batch(asked, output, client, **QUICK)
            assert Counter(report.objects["scan"]) == {"a": 3, "b": 3}
            folders = pd.read_parquet(output / "scans.parquet").set_index("scan")["folder"]
            assert folders["a"] == now.folder
            assert session_in(output, "a").parent == output / now.folder
    file.rename(scans / "new-name.npz")
    nu.batch(scans, output, client, **QUICK)
    assert session_in(output, "new-name").parent == output / first.folder
    # Another file has the name now, and that one has the other's.
    for here, there in (("new-name", "t"), ("b", "new-name"), ("t", "b")):
        (scans / f"{here}.npz").rename(scans / f"{there}.npz")
    nu.batch(scans, output, client, **QUICK)
    folders = pd.read_parquet(output / "scans.parquet").set_index("scan")["folder"]
    for name in ("b", "new-name"):
        assert session_in(output, name).parent == output / folders[name]
    for here, there in (("new-name", "t"), ("b", "new-name"), ("t", "b")):
        (scans / f"{here}.npz").rename(scans / f"{there}.npz")
    nu.batch(scans, output, client, **QUICK)
    # A result without its table is none.
    (output / first.folder / "objects.parquet").unlink()
    report = nu.batch(scans, output, client, **QUICK)
    assert [one.status for one in report.results] == ["kept", "done"]
    assert Counter(report.objects["scan"]) == {"b": 3, "new-name": 3}


@pytest.mark.skipif(sys.platform != "linux", reason="other systems know no such names")
def test_a_file_whose_name_is_not_utf_8_is_worked_on_and_told_like_any_other(
    bags: Path, client: Any, tmp_path: Path
) -> None:
    scans, output = tmp_path / "in", tmp_path / "out"
    scans.mkdir()
    # As a disk of the days of Latin-1 has them, one whole and one broken.
    whole = scans / os.fsdecode(b"Sch\xe4del.npz")
    shutil.copy(bags / "a.npz", whole)
    (scans / os.fsdecode(b"kaputt\xe4.npz")).write_bytes(b"PK not an archive")
    shutil.copy(bags / "c.npz", scans)
    report = nu.batch(scans, output, client)
    told = {one.scan: one.status for one in report.results}
    assert told == {"Sch?del": "done", "c": "done", "kaputt?": "failed"}
    assert set(report.objects["scan"]) == {"Sch?del", "c"}
    assert "Sch?del" in report.index.read_text("utf-8")
    assert session_in(output, "Sch?del").exists()
    assert load_volume(whole).name == "Sch?del"
    for command in ("table", "web"):
        done = run(command, whole, tmp_path / "page.html")
        assert done.exit_code == 0, done.output
        assert "Sch?del" in (tmp_path / "page.html").read_text("utf-8")


def test_equal_settings_are_known_by_one_hash() -> None:
    plain = Settings(smallest=200.0, view=(-1.0, 0.0, 0.0), direction=(0.0, 1.0, 0.0), grainy=True)
    listed: Any = {"smallest": 200, "view": [-1, 0, 0], "direction": [0, 1, 0], "grainy": True}
    arrays = {name: np.array(value)[()] for name, value in listed.items()}
    for given in (listed, arrays):
        assert Settings(**given, pictures=np.True_) == plain
        assert identity_of_settings(Settings(**given)) == identity_of_settings(plain)
    # As runs before it were written: their results are kept.
    told = {"smallest": 200.0, "grainy": True, "view": [-1.0, 0.0, 0.0], "film": False}
    told |= {"direction": [0.0, 1.0, 0.0], "pictures": True, "labels": "npz", "copies": True}
    told["version"] = plain.record()["version"]
    assert plain.record() == told
    known = hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()
    assert identity_of_settings(plain) == known
