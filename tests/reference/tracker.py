"""The whole tracker: Algorithm 1 in `Tracker.step`, Algorithm 2 in `Tracker.learn` and `choose`."""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from . import selection, strong, weak
from .records import Floats, Integers, Pool, Settings
from .samples import LABELS, training_places, training_responses
from .search import move, nearest_place, peak, score_map, squared_distances
from .window import cell_means, integral


class Maps(NamedTuple):
    """What the search looks at, for every candidate place.

    probabilities: [K, Cy, Cx], of the parts, smoothed. evidence: [Cy, Cx], smoothed.
    scores: [Cy, Cx], evidence less the motion prior, minus infinity where it cannot be.
    """

    probabilities: Floats
    evidence: Floats
    scores: Floats


@dataclass
class Tracker:
    """One track and all it remembers; `Tracker.init` starts one, the constructor resumes one.

    box: [4], x, y, w, h, pixels. pool: `Pool`, or anything with its three fields.
    means: [F, 2], column 0 background, column 1 object. sigma: [F, 2], or None with "midpoint".
    variance: [2], P of each class, or one number for both. correct, wrong: [F], from 1.
    selected: [K, N] in [0, M). alpha: [K, N].
    The arrays are copied; the copies are float64 (indices int64).
    """

    settings: Settings
    box: Floats
    pool: Pool
    means: Floats
    sigma: Floats | None
    variance: Floats
    correct: Floats
    wrong: Floats
    selected: Integers
    alpha: Floats

    def __post_init__(self) -> None:
        self.box = np.array(self.box, np.float64)
        self.pool = Pool(
            np.array(self.pool.corners, np.int64),
            np.array(self.pool.weights, np.float64),
            np.array(self.pool.boxes, np.int64),
        )
        self.means = np.array(self.means, np.float64)
        self.sigma = None if self.sigma is None else np.array(self.sigma, np.float64)
        self.variance = np.full(2, self.variance, np.float64)
        self.correct = np.array(self.correct, np.float64)
        self.wrong = np.array(self.wrong, np.float64)
        self.selected = np.array(self.selected, np.int64)
        self.alpha = np.array(self.alpha, np.float64)

    @classmethod
    def init(cls, frame: np.ndarray, box: Floats, pool: Pool, settings: Settings) -> Self:
        """A track that has learnt the object from its first frame.

        frame: uint8 [H, W] or [H, W, 3]. box: [4], x, y, w, h, pixels.
        """
        features = len(pool.boxes)
        of_selectors = (settings.parts, settings.selectors)
        tracker = cls(
            settings,
            box,
            pool,
            means=np.zeros((features, 2)),
            sigma=weak.first_sigma(pool.boxes) if settings.weak == "gaussian" else None,
            variance=np.full(2, weak.FIRST_VARIANCE),
            correct=np.ones(features),
            wrong=np.ones(features),
            selected=np.zeros(of_selectors, np.int64),
            alpha=np.zeros(of_selectors),
        )
        responses = tracker.training_rows(frame)
        for _ in range(settings.first_updates):
            tracker.learn(responses)
        tracker.choose(responses)
        return tracker

    def step(self, frame: np.ndarray) -> tuple[Floats, float, Floats]:
        """Algorithm 1: find the object in the next frame and learn from it.

        Returns box [4] in pixels, confidence and part scores [K], both in [0, 1] to rounding.
        """
        grid = self.settings.grid
        maps = self.search(frame)
        displacement = peak(maps.scores, squared_distances(self.box, grid))
        row, column = nearest_place(displacement, grid)
        confidence = float(1 - np.exp(-maps.evidence[row, column]))
        part_scores = maps.probabilities[:, row, column]

        self.box = move(self.box, displacement, frame.shape[:2], grid)
        responses = self.training_rows(frame)
        self.learn(responses)
        self.choose(responses)
        return self.box.copy(), confidence, part_scores

    def search(self, frame: np.ndarray) -> Maps:
        """The maps of the window around the last box in this frame."""
        settings, grid = self.settings, self.settings.grid
        window_integral = integral(cell_means(frame, self.box, grid))
        maps = []
        for k in range(settings.parts):
            features = self.selected_features()[k]
            maps.append(
                strong.strong_map(
                    window_integral,
                    self.pool.corners[features],
                    self.pool.weights[features],
                    self.means[features],
                    None if self.sigma is None else self.sigma[features],
                    self.alpha[k],
                    grid,
                )
            )
        probabilities = strong.part_probabilities(np.stack(maps), settings.smoothing)
        evidence = strong.evidence(probabilities, settings.smoothing)
        scores = score_map(
            evidence, self.box, frame.shape[:2], grid, settings.prior, settings.slack
        )
        return Maps(probabilities, evidence, scores)

    def training_rows(self, frame: np.ndarray) -> Floats:
        """Values [F, L] of all features on the training rows around the present box."""
        grid = self.settings.grid
        places = training_places(self.box, frame.shape[:2], grid, self.settings.slack)
        return training_responses(cell_means(frame, self.box, grid), places, self.pool, grid)

    def learn(self, responses: Floats) -> None:
        """One update of all weak classifiers, and the count of right and wrong votes after it.

        responses: [F, L].
        """
        self.means, self.sigma, self.variance = weak.kalman_update(
            responses, LABELS, self.means, self.sigma, self.variance
        )
        rows = weak.votes(responses, self.means, self.sigma)
        self.correct, self.wrong = weak.count(rows, LABELS, self.correct, self.wrong)

    def choose(self, responses: Floats) -> None:
        """Every selector chooses from its pool by the votes on these rows, [F, L]."""
        settings = self.settings
        pools = (settings.parts, settings.selectors, settings.pool_size)
        rows = weak.votes(responses, self.means, self.sigma)
        phi = np.swapaxes(rows.reshape(*pools, len(LABELS)), -1, -2)  # [K, N, L, M]
        errors = weak.error(self.correct, self.wrong)
        match settings.selector:
            case "l1":
                self.selected = selection.select_l1(phi, LABELS, settings.lam, settings.iterations)
            case "error":
                self.selected = selection.select_error(errors.reshape(pools))
            case "first":
                self.selected = selection.select_first(phi, LABELS)
            case "mil":
                self.selected = selection.select_mil(phi, LABELS)
        self.alpha = strong.voting_weight(errors[self.selected_features()])

    def selected_features(self) -> Integers:
        """Index [K, N] in the pool of all F features of what each selector has chosen."""
        settings = self.settings
        first_of_pool = np.arange(settings.parts * settings.selectors) * settings.pool_size
        return first_of_pool.reshape(self.selected.shape) + self.selected
