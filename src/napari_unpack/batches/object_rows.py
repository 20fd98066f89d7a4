"""The table of all objects of a run: Parquet, one row an object, columns of every scan alike."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from napari_unpack.atomic import written_atomically

if TYPE_CHECKING:
    from napari_unpack.session import Session

GROUP_ROWS = 100_000
"""Rows of a row group: what is in memory at once while tables are joined."""


def _schema() -> Any:
    import pyarrow as pa

    real = ("volume_mm3", "long_mm", "middle_mm", "short_mm", "mean_density", "z", "y", "x")
    return pa.schema(
        {
            "scan": pa.string(),
            "id": pa.int64(),
            "name": pa.string(),
            "voxels": pa.int64(),
            **dict.fromkeys((*real, "isoperimetric_ratio", "confidence"), pa.float64()),
            "order": pa.int32(),
            "blocked_by": pa.list_(pa.int64()),
        }
    )


def write_object_rows(
    session: Session, blockers: Mapping[int, Iterable[int]], scan: str, path: Path
) -> None:
    """Write the objects of one scan.

    Parameters
    ----------
    session : Session
        Whose `steps` are the whole unpacking.
    blockers : mapping of int to iterable of int
        Who stands directly in the way of each object.
    scan : str
        Its name.
    path : Path
        The file.
    """
    import pyarrow as pa
    from pyarrow import parquet

    facts = session.objects.to_dict("index")
    order = {i: step for step, group in enumerate(session.steps, 1) for i in group}
    schema = _schema()
    rows: list[dict[str, Any]] = []
    for i in session.ids:
        edges = (float(v) for v in session.bag.oriented(i).size)
        row: dict[str, Any] = dict(zip(("long_mm", "middle_mm", "short_mm"), edges, strict=True))
        row |= {name: facts[i].get(name) for name in schema.names if name in facts[i]}
        row |= {"scan": scan, "id": session.label_of(i), "order": order.get(i)}
        row["blocked_by"] = [session.label_of(k) for k in blockers.get(i, ())]
        rows.append(row)
    with written_atomically(path) as temporary:
        parquet.write_table(pa.Table.from_pylist(rows, schema), temporary)


def join_object_rows(tables: Iterable[tuple[str, Path]], path: Path) -> None:
    """Join the tables of many scans.

    Parameters
    ----------
    tables : iterable of (str, Path)
        The name that each scan has now, and its table.
    path : Path
        The file; what was there is replaced once the new one is whole.
    """
    from pyarrow import parquet

    schema = _schema()
    with (
        written_atomically(path) as temporary,
        parquet.ParquetWriter(temporary, schema) as writer,
    ):
        for group in _groups(tables):
            writer.write_table(group)


def _groups(tables: Iterable[tuple[str, Path]]) -> Iterator[Any]:
    import pyarrow as pa
    from pyarrow import parquet

    waiting: list[Any] = []
    for scan, path in tables:
        table = parquet.read_table(path, schema=_schema())
        names = pa.array([scan] * len(table), pa.string())
        waiting.append(table.set_column(0, "scan", names))
        if sum(map(len, waiting)) >= GROUP_ROWS:
            yield pa.concat_tables(waiting)
            waiting = []
    if waiting:
        yield pa.concat_tables(waiting)
