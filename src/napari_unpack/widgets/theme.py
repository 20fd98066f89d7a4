"""The panel's look: one style sheet, made from the colours of napari's theme.

A widget names its `role` in a property (primary, badge, title, hint, warning, link), and the
style sheet says how that looks in a light or dark theme.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from qtpy.QtGui import QColor

if TYPE_CHECKING:
    from pydantic_extra_types.color import Color

# Pixels between neighbouring controls; sections are two of them apart.
GAP = 6

# Width of the column of field labels, pixels; the same in every step.
LABELS = 74

# Least width of a box with a number, without its padding, pixels: its arrows and four digits, of
# which napari's own cuts the last.
NUMBERS = 78


@dataclass(frozen=True)
class Palette:
    """The colours of the panel.

    Parameters
    ----------
    background, raised, line, text, faint, disabled, placeholder : str
        CSS colours of the panel, of controls upon it, thin rules, text, text of less weight, text
        of what cannot be used, and what an empty line to type into says.
    accent, accent_hover, on_accent, chosen, warning : str
        The primary button, the same under the mouse, text on it, selected rows, and warnings.
    focus : str
        The ring around the control that has the keyboard.
    """

    background: str
    raised: str
    line: str
    text: str
    faint: str
    disabled: str
    placeholder: str
    accent: str
    accent_hover: str
    on_accent: str
    chosen: str
    warning: str
    focus: str


def palette_of(theme: str) -> Palette:
    """Derive the palette from a napari theme, by its name as in ``viewer.theme``."""
    from napari.utils.theme import get_theme

    colors = get_theme(theme)
    background, text = _color(colors.background), _color(colors.text)
    accent = _color(colors.current)
    dark = background.lightness() < 128
    # On the accent stands white text, and under the mouse it must stay as plain.
    accent = accent.lighter(115) if dark else accent.darker(170)
    return Palette(
        background=background.name(),
        raised=_color(colors.foreground).name(),
        line=_mixed(background, text, 0.16),
        text=text.name(),
        faint=_mixed(background, text, 0.7),
        disabled=_mixed(background, text, 0.62),
        # Upon napari's own fields.
        placeholder=_mixed(_color(colors.primary), text, 0.75),
        accent=accent.name(),
        accent_hover=accent.darker(112).name(),
        on_accent="#ffffff",
        chosen=_mixed(background, accent, 0.42 if dark else 0.3),
        warning="#e3b617" if dark else "#8a5a00",
        # Another colour than the primary button's, on which it is to be seen too.
        focus="#ffd166" if dark else "#b3261e",
    )


def _color(color: Color) -> QColor:
    return QColor(*color.as_rgb_tuple()[:3])


def _mixed(a: QColor, b: QColor, part: float) -> str:
    pairs = zip(a.getRgb()[:3], b.getRgb()[:3], strict=True)
    return QColor(*(round(x + (y - x) * part) for x, y in pairs)).name()


def style_sheet(palette: Palette) -> str:
    """Write Qt's style sheet of the whole panel."""
    p = palette
    return f"""
    QWidget#unpacking_panel {{ background: {p.background}; }}
    QScrollArea {{ border: none; background: {p.background}; }}
    QLabel {{ background: transparent; color: {p.text}; }}
    QLabel[role="badge"] {{
        background: {p.raised}; color: {p.text}; border-radius: 10px; font-weight: 600;
        min-width: 20px; max-width: 20px; min-height: 20px; max-height: 20px; }}
    QLabel[role="badge"][ready="true"] {{ background: {p.accent}; color: {p.on_accent}; }}
    QLabel[role="title"] {{ font-weight: 600; font-size: 13px; }}
    QLabel[role="hint"], QLabel[role="status"] {{ color: {p.faint}; }}
    QLabel[role="status"] {{ padding: 0px; }}
    QLabel[role="warning"] {{ color: {p.warning}; }}
    QWidget[role="rule"] {{ background: {p.line}; }}
    QPushButton {{
        padding: 3px 7px; border-radius: 4px; min-height: 16px; border: 1px solid transparent; }}
    QPushButton[role="primary"] {{
        background: {p.accent}; color: {p.on_accent}; font-weight: 600; padding: 5px 7px; }}
    QPushButton[role="primary"]:hover {{ background: {p.accent_hover}; }}
    QPushButton[role="primary"]:disabled {{ background: {p.raised}; color: {p.disabled}; }}
    QPushButton:disabled, QComboBox:disabled, QCheckBox:disabled {{ color: {p.disabled}; }}
    QToolButton[role="link"] {{
        background: transparent; border: 1px solid transparent; color: {p.faint}; padding: 0px; }}
    QToolButton[role="link"]:hover {{ color: {p.text}; }}
    QComboBox, QAbstractSpinBox, QLineEdit, QCheckBox, QSlider {{
        border: 1px solid transparent; border-radius: 3px; }}
    QLineEdit {{ placeholder-text-color: {p.placeholder}; }}
    QAbstractSpinBox {{ min-width: {NUMBERS}px; }}
    QPushButton:focus, QToolButton:focus, QComboBox:focus, QAbstractSpinBox:focus,
    QLineEdit:focus, QCheckBox:focus, QSlider:focus, QTableView:focus {{
        border: 1px solid {p.focus}; border-radius: 3px; }}
    QProgressBar {{
        border: none; border-radius: 3px; background: {p.raised}; min-height: 6px;
        max-height: 6px; }}
    QProgressBar::chunk {{ border-radius: 3px; background: {p.accent}; }}
    QTableView {{
        border: 1px solid {p.line}; border-radius: 4px; background: {p.background};
        alternate-background-color: {p.background}; gridline-color: {p.line};
        selection-background-color: {p.chosen}; selection-color: {p.text}; }}
    QTableView::item {{ padding: 0px 4px; }}
    QTableView::item:selected {{ background: {p.chosen}; color: {p.text}; }}
    QHeaderView::section {{
        background: {p.background}; color: {p.faint}; border: none; padding: 3px 4px;
        border-bottom: 1px solid {p.line}; }}
    """
