"""Perfect correspondences on beans, made without the code under test's geometry."""

import numpy as np
import pytest

from homolog.beans.generate import Bean, draw_beans
from homolog.beans.surface import rim


def _follow(curve, fractions):
    """Points of a polyline (n, 2) at fractions of its length."""
    length = np.concatenate([[0.0], np.linalg.norm(np.diff(curve, axis=0), axis=1).cumsum()])
    return np.stack([np.interp(fractions * length[-1], length, side) for side in curve.T], axis=1)


def _slice(bean, x, start, reach):
    """Outer and slot curves (n, 2) of the section at x; beyond the slot, one curve from `start`."""
    big = bean.body_axes[1:] * np.sqrt(1.0 - (x / bean.body_axes[0]) ** 2)
    turn = np.linspace(0.0, 2.0 * np.pi, 8001)
    if abs(x) >= reach:
        return np.stack([np.sin(start + turn), np.cos(start + turn)], axis=1) * big, None
    small = bean.slot_axes[1:] * np.sqrt(1.0 - (x / bean.slot_axes[0]) ** 2)
    centre = bean.slot_centre[1:]
    outer = np.stack([np.sin(turn - np.pi), np.cos(turn - np.pi)], axis=1) * big
    outer = outer[(((outer - centre) / small) ** 2).sum(axis=1) > 1.0]
    split = np.argmax(np.linalg.norm(np.diff(outer, axis=0), axis=1)) + 1
    outer = np.concatenate([outer[split:], outer[1:split]])
    slot = np.stack([np.sin(turn - np.pi), -np.cos(turn - np.pi)], axis=1) * small + centre
    return outer, slot[((slot / big) ** 2).sum(axis=1) < 1.0]


def _girth_map(bean, rows):
    """Place the same rows of (outer fractions, slot fractions) on a bean, scaled to its slot's length."""
    curve = rim(bean)
    tip = curve[:, 0].argmax()
    reach = curve[tip, 0]
    start = np.arctan2(curve[tip, 1] / bean.body_axes[1], curve[tip, 2] / bean.body_axes[2])
    points = []
    for u, outer_at, slot_at in rows:
        inner = min(abs(u) / 0.6, 1.0) * reach
        x = np.sign(u) * (inner + max(abs(u) - 0.6, 0.0) / 0.4 * (bean.body_axes[0] - reach))
        outer, slot = _slice(bean, x, start, reach)
        section = [_follow(outer, outer_at)] + ([_follow(slot, slot_at)] if slot is not None else [])
        section = np.concatenate(section)
        points.append(np.column_stack([np.full(len(section), x), section]))
    return np.concatenate(points)


def _rows(count):
    """Rows whose points are about evenly spread on a bean with a middling slot."""
    spacing = np.sqrt(11700.0 / count)
    across = round(80.0 / spacing)
    rows = []
    for u in (np.arange(across) + 0.5) / across * 2.0 - 1.0:
        size = np.sqrt(max(1.0 - u**2, 0.0))
        outer = max(round((158.0 * size - (16.0 if abs(u) < 0.6 else 0.0)) / spacing), 1)
        slot = round(29.0 * np.sqrt(1.0 - (u / 0.6) ** 2) / spacing) if abs(u) < 0.6 else 0
        rows.append((u, (np.arange(outer) + 0.5) / outer, (np.arange(slot) + 0.5) / max(slot, 1)))
    return rows


@pytest.fixture(scope="session")
def wide_beans():
    return draw_beans(10, 5)


@pytest.fixture(scope="session")
def ideal_particles(wide_beans):
    """About 1000 perfectly corresponding points (M, N, 3): the outer curve slides with the slot."""
    rows = _rows(1000)
    return np.stack([_girth_map(bean, rows) for bean in wide_beans])


@pytest.fixture(scope="session")
def still_beans(wide_beans):
    """Six beans that differ by less than any figure can see, except R² and the shares of variance."""
    shifts = np.random.default_rng(7).normal(0.0, 1e-6, (6, 2))
    first = wide_beans[0]
    return [Bean(first.geometry, first.position + p, first.width + w) for p, w in shifts]
