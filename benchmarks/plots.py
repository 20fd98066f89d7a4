"""The steps of an unpacking as a table in Markdown and a plot in SVG."""

from __future__ import annotations

import csv
import io
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "docs"
WIDTH, HEIGHT, MARGIN = 720, 300, 48
LINES = (
    ("occlusion_ms", "#d9480f", "occlusion, ms"),
    ("interference_ms", "#1971c2", "interference, ms"),
)


def section(figures: dict[str, str]) -> str:
    """Write the plot beside the document and return the section that shows it."""
    if "unpacking.csv" not in figures:
        return ""
    rows = list(csv.DictReader(io.StringIO(figures["unpacking.csv"])))
    (FOLDER / "unpacking-steps.svg").write_text(svg(rows))
    lines = [
        "\n## Every step of an unpacking\n",
        "The paper's figures 7 and 8. Dots mark steps at which the queue was asked; at the others "
        "it was reused and the times were measured all the same. Times are the least of three "
        "whole unpackings, for all methods alike.\n",
        "![Times at every step](unpacking-steps.svg)\n",
        "| step | object | queue | mean ratio | occlusion ms, CPU | GL queries ms | GL atomics ms "
        "| interference ms |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        asked = "asked" if row["asked"] == "1" else "reused"
        lines.append(
            f"| {row['step']} | {row['object_id']} | {asked} | {row['mean_ratio']} "
            f"| {row['occlusion_ms']} | {row.get('queries_ms', '')} | {row.get('atomics_ms', '')} "
            f"| {row['interference_ms']} |"
        )
    return "\n".join(lines) + "\n"


def svg(rows: list[dict[str, str]]) -> str:
    """Return the plot."""
    top = max(float(row[name]) for row in rows for name, _, _ in LINES) * 1.1
    across = (WIDTH - 2 * MARGIN) / max(len(rows) - 1, 1)

    def place(i: int, value: float) -> tuple[float, float]:
        return MARGIN + i * across, HEIGHT - MARGIN - value / top * (HEIGHT - 2 * MARGIN)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        'font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
    ]
    for k in range(5):
        x, y = place(0, top * k / 4)
        parts.append(f'<path d="M{x} {y:.1f}H{WIDTH - MARGIN}" stroke="#dee2e6"/>')
        parts.append(
            f'<text x="{x - 6}" y="{y + 4:.1f}" text-anchor="end">{top * k / 4:.0f}</text>'
        )
    for name, color, title in LINES:
        points = [place(i, float(row[name])) for i, row in enumerate(rows)]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        parts.append(f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="2"/>')
        for (x, y), row in zip(points, rows, strict=True):
            if row["asked"] == "1" and name == "occlusion_ms":
                parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5" fill="{color}"/>')
        place_of_title = MARGIN + 8 + 150 * (name == "interference_ms")
        parts.append(f'<text x="{place_of_title}" y="24" fill="{color}">{title}</text>')
    parts.append(
        f'<text x="{WIDTH / 2}" y="{HEIGHT - 12}" text-anchor="middle">objects unpacked</text>'
        "</svg>"
    )
    return "\n".join(parts) + "\n"
