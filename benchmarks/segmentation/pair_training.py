"""Fitting classifiers of pairs that stay quiet about pairs that they have not seen.

It needs `pip install --group train`, as the training of the network does.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from benchmarks.segmentation.pair_examples import ensemble
from napari_unpack.segmentation.learned.pair_classifier import PairClassifier


@dataclass(frozen=True)
class Recipe:
    """How a classifier of pairs is fitted.

    Parameters
    ----------
    hidden : tuple of int
        Widths of the hidden layers.
    dropout : float
        Share of what hidden layers say that is left out at each step. With it, larger networks are
        better on families that they have not learned from; without, worse.
    restraint : float
        Weight of the squared weights.
    epochs, batch : int
    rate : float
        The highest; it rises from and falls to nearly nothing.
    members : int
        Networks, each from other initial weights, whose mean counts.
    """

    hidden: tuple[int, ...] = (64, 32)
    dropout: float = 0.1
    restraint: float = 3.0
    epochs: int = 40
    batch: int = 512
    rate: float = 4e-3
    members: int = 5


def fit_ensemble(
    rows: NDArray[np.float64],
    same: NDArray[np.bool_],
    features: tuple[str, ...],
    recipe: Recipe | None = None,
) -> PairClassifier:
    """Return the mean of several networks, see `ensemble`.

    Parameters
    ----------
    rows : (N, F) ndarray of float64
        Pairs.
    same : (N,) ndarray of bool
        Whether they are one object.
    features : tuple of str
        Names of the columns.
    recipe : Recipe, optional
    """
    torch.set_num_threads(1)
    how = recipe or Recipe()
    return ensemble([_fitted(rows, same, features, how, seed) for seed in range(how.members)])


def _fitted(
    rows: NDArray[np.float64],
    same: NDArray[np.bool_],
    features: tuple[str, ...],
    recipe: Recipe,
    seed: int,
) -> PairClassifier:
    torch.manual_seed(seed)
    order = torch.Generator().manual_seed(seed)
    center, scale = np.median(rows, axis=0), rows.std(axis=0) + 1e-6
    # As `PairClassifier.probability` has them.
    given = torch.tensor(np.clip((rows - center) / scale, -6, 6), dtype=torch.float32)
    wanted = torch.tensor(same, dtype=torch.float32)
    widths = (rows.shape[1], *recipe.hidden, 1)
    layers = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(widths))
    for layer in layers:
        nn.init.xavier_normal_(layer.weight)
        nn.init.zeros_(layer.bias)
    optimizer = torch.optim.AdamW(layers.parameters(), recipe.rate, weight_decay=0.0)
    batches = max(len(rows) // recipe.batch, 1)
    steps = recipe.epochs * batches
    rates = torch.optim.lr_scheduler.OneCycleLR(optimizer, recipe.rate, steps)
    for _ in range(recipe.epochs):
        for chosen in torch.randperm(len(rows), generator=order).split(recipe.batch)[:batches]:
            values = given[chosen]
            for layer in layers[:-1]:
                values = functional.dropout(torch.tanh(layer(values)), recipe.dropout)
            said = layers[-1](values)[:, 0]
            loss = functional.binary_cross_entropy_with_logits(said, wanted[chosen])
            squares = sum((layer.weight**2).sum() for layer in layers)
            loss = loss + 0.5 * recipe.restraint / len(rows) * squares
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            rates.step()
    weights = tuple(layer.weight.detach().numpy().T.copy() for layer in layers)
    offsets = tuple(layer.bias.detach().numpy().copy() for layer in layers)
    return PairClassifier(center, scale, weights, offsets, features)
