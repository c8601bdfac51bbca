"""The whole tracker: Algorithm 1 in `Tracker.step`, Algorithm 2 in `update_weak` and `select`.

What the default has beyond the paper has one `if` for each component wherever it acts.
"""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from . import (
    aspect,
    colour,
    redetection,
    rotation,
    scale,
    selection,
    strong,
    translation,
    verification,
    weak,
)
from .colour import ColourState
from .descriptors import describe, describe_scales
from .filters import Filter
from .records import Candidate, Floats, Integers, Maps, Pool, Settings, StepInfo
from .rotation import RotationState
from .samples import LABELS, reachable, training_positions, training_responses
from .search import move, nearest_position, peak, squared_distances, with_motion_prior
from .translation import TranslationState
from .verification import VerificationState
from .window import cell_aspect, integral, shown_box, window_cells

HERE = np.zeros(2)  # no displacement


@dataclass
class Tracker:
    """One track and all it remembers; `Tracker.init` starts one, the constructor resumes one.

    box: [4], x, y, w, h, pixels. initial_size: [2], w and h of the initial box, pixels.
    pool: `Pool`, or anything with its three fields.
    means: [F, 2], column 0 background, column 1 object. sigma: [F, 2], or None with "midpoint".
    variance: [2], P of each class, or one number for both. correct, wrong: [F], from 1.
    selected: [K, N] in [0, M). alpha: [K, N].
    translation, colour, scale, verification, rotation: of the components, None where one is
        switched off.
    The arrays are copied; the copies are float64 (indices int64). None is changed in place.
    """

    settings: Settings
    box: Floats
    initial_size: Floats
    pool: Pool
    means: Floats
    sigma: Floats | None
    variance: Floats
    correct: Floats
    wrong: Floats
    selected: Integers
    alpha: Floats
    translation: TranslationState | None = None
    colour: ColourState | None = None
    scale: Filter | None = None
    verification: VerificationState | None = None
    rotation: RotationState | None = None

    def __post_init__(self) -> None:
        self.box = np.array(self.box, np.float64)
        self.initial_size = np.array(self.initial_size, np.float64)
        width, height = map(float, self.initial_size)
        self.settings = replace(self.settings, initial_size=(width, height))
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
        """A track that has learned the object from its first frame.

        frame: uint8 [H, W] or [H, W, 3]. box: [4], x, y, w, h, pixels.
        """
        features = len(pool.boxes)
        of_selectors = (settings.parts, settings.selectors)
        tracker = cls(
            settings,
            box,
            box[2:],
            pool,
            means=np.zeros((features, 2)),
            sigma=weak.first_sigma(pool.boxes) if settings.weak == "gaussian" else None,
            variance=np.full(2, weak.FIRST_VARIANCE),
            correct=np.ones(features),
            wrong=np.ones(features),
            selected=np.zeros(of_selectors, np.int64),
            alpha=np.zeros(of_selectors),
        )
        cells = tracker.window(frame, tracker.box)
        responses = tracker.training_samples(cells, frame.shape)
        for _ in range(settings.first_updates):
            tracker.update_weak(responses)
        tracker.select(responses)
        descriptions = tracker.describe(cells, HERE)
        if settings.translation:
            tracker.translation = translation.init(cells, settings.translation, settings.grid)
        if settings.colour:
            tracker.colour = colour.init(tracker.colours(frame, box), tracker.box, settings)
        if settings.scale:
            tracker.scale = scale.init(descriptions)
        if settings.verification:
            tracker.verification = verification.init(own_scale(descriptions), tracker.box)
        if settings.rotation:
            tracker.rotation = rotation.init(tracker.polar(cells, HERE, tracker.box))
        return tracker

    def step(self, frame: np.ndarray) -> StepInfo:
        """Algorithm 1: find the object in the next frame and learn from it."""
        # Lines 1-3: where in the window around its last position is the object most likely?
        best = self.search_elsewhere(frame, self.localise(frame, self.box))
        confidence, noise = best.confidence, np.zeros(5)
        settings = self.settings.verification
        if self.rests(best):
            self.keep_up(best)
        else:
            # Line 4 and Algorithm 2: what there is to learn at the new position.
            updated = replace(self, box=best.box, rotation=best.rotation)
            cells = updated.window(frame, best.box)
            noise = updated.update(cells, frame)
            if settings:
                confidence = self.verify(cells, updated, best)
            else:
                self.become(updated)
        if settings and self.settings.translation:
            confidence = verification.combine(confidence, best.responses, settings)
        return StepInfo(
            self.output(best.box),
            confidence,
            best.noisy_or,
            best.part_scores,
            self.is_lost(),
            noise,
        )

    def localise(self, frame: np.ndarray, box: Floats) -> Candidate:
        """The most likely position, and size, of the object in the window around a box."""
        settings = self.settings
        searched, cells = box, self.window(frame, box)
        maps, middle = self.search(frame, cells, box)
        subcell = settings.translation is not None
        distances = squared_distances(box, settings, middle)
        displacement = middle + peak(maps.scores, distances, subcell)
        row, column = nearest_position(displacement, settings.search_grid) - middle
        noisy_or = float(1 - np.exp(-maps.score_map[row, column]))

        box = move(box, displacement, frame.shape, settings, self.angle)
        descriptions = self.describe(cells, displacement)
        confidence, pull, keep_size = math.nan, 0.0, False
        description = own_scale(descriptions)
        if self.verification and settings.verification:
            known = self.verification
            similarity = verification.similarity(known, description, settings.verification)
            confidence = verification.score(similarity, settings.verification)
            # Behind something, perhaps, the object keeps its size.
            keep_size = not confidence > settings.verification.sure_above
            if self.angle != 0:
                # So does one that has turned and is not like its initial template.
                of_first = verification.score(
                    float(known.initial @ description), settings.verification
                )
                keep_size = keep_size or not of_first > settings.verification.lost_below
            if settings.scale:
                pull = scale.pull(box, self.initial_size, similarity, settings.scale)
        if self.scale and settings.scale and not keep_size:
            steps = scale.estimate(self.scale, descriptions) - pull
            box = scale.resize(box, steps, frame.shape, settings.scale)
        if self.verification and settings.aspect and not keep_size:
            box = self.narrower(box, cells, displacement)
        responses = math.nan
        if self.translation and settings.translation:
            responses = translation.responses(self.translation, cells, displacement, settings.grid)
        part_scores = maps.probabilities[:, row, column]
        rotated = self.turned(cells, displacement, confidence, searched)
        return Candidate(box, confidence, noisy_or, part_scores, description, responses, rotated)

    def narrower(self, box: Floats, cells: Floats, displacement: Floats) -> Floats:
        """The box [4] in the aspect ratio that the object has.

        cells: [Gy, Gx], of the window. displacement: [2], from its middle, cells.
        """
        known, settings = self.verification, self.settings.aspect
        assert known
        assert settings

        def similarity(steps: float) -> float:
            taller = aspect.STEP**steps
            patch = describe(cells, displacement, 1.0, self.settings.grid, taller)
            return float(known.initial @ patch)

        return aspect.follow(
            box, self.initial_size, similarity, settings, rested=known.num_rested > 0
        )

    def turned(
        self, cells: Floats, displacement: Floats, confidence: float, box: Floats
    ) -> RotationState | None:
        """The state of the rotation filter after a frame in which the object is there.

        cells: [Gy, Gx], of the turned window around a box. displacement: [2], from its middle,
        cells.
        """
        state, known, settings = self.rotation, self.verification, self.settings.rotation
        if not (state and known and settings):
            return None
        of_cell = cell_aspect(box, self.settings)

        def similarity(angle: float) -> float:
            if angle == 0:
                description = own_scale(self.describe(cells, displacement))
            else:
                description = rotation.describe_turned(
                    cells, displacement, angle, of_cell, self.settings.grid
                )
            return float(known.initial @ description)

        features = self.polar(cells, displacement, box)
        return rotation.follow(state, features, similarity, confidence, settings)

    def search(self, frame: np.ndarray, cells: Floats, box: Floats) -> tuple[Maps, Integers]:
        """What there is at every position in the search window within [Gy, Gx] around a box.

        cells: [Gy, Gx], of the window around the box.
        Returns also the displacement [2] of the search window from the box, cells.
        """
        settings, whole, grid = self.settings, self.settings.grid, self.settings.search_grid
        middle, response = np.zeros(2, np.int64), None
        colours = self.colours(frame, box)
        of_object = None
        if self.colour and colours is not None:
            of_object = colour.pixel_probabilities(self.colour, colours)

        def by_colour(displacement: Floats) -> float:
            if self.colour is None or of_object is None:
                return 0.0
            return colour.score(self.colour, of_object, displacement, box, settings)

        if self.translation and settings.translation:
            response = translation.respond(self.translation, cells, settings.translation, whole)
            middle = translation.search_middle(
                response, by_colour, box, frame.shape, settings, self.angle
            )
        top = whole.margin_rows - grid.margin_rows + middle[0]
        left = whole.margin_columns - grid.margin_columns + middle[1]
        height, width = grid.window
        window_integral = integral(cells[top : top + height, left : left + width])
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
        score_map = strong.score_map(probabilities, settings.smoothing)
        scores = score_map.copy()
        if response is not None:
            scores = scores + translation.score(response, middle, settings)
        for i in range(grid.positions[0]):
            for j in range(grid.positions[1]):
                at = np.array([i - grid.margin_rows, j - grid.margin_columns])
                scores[i, j] += by_colour(middle + at)
        reach = reachable(box, frame.shape, settings)
        scores = with_motion_prior(scores, box, reach, settings, middle, self.angle)
        return Maps(probabilities, score_map, scores), middle

    def search_elsewhere(self, frame: np.ndarray, best: Candidate) -> Candidate:
        """The candidate, or a better one if it is not recognised, or the object was missed last.

        In the first case by the translation filter of the first frame, in the second one in further
        windows, too. Around where it was verified last it has to be sure, elsewhere more than that.
        """
        state = self.verification
        if state is None:
            return best
        assert self.settings.verification
        sure_above = self.settings.verification.sure_above
        if state.num_missed > 0 or best.confidence <= self.settings.verification.lost_below:
            other = self.as_at_first().localise(frame, self.box)
            if other.confidence > max(best.confidence, sure_above):
                best = other
        if state.num_missed == 0:
            return best
        places = [(state.box, sure_above)]
        if self.settings.redetection:
            tiles = redetection.search_windows(
                state.box, state.num_missed, frame.shape, self.settings
            )
            places += [(box, self.settings.redetection.accept_above) for box in tiles]
        for box, least in places:
            other = self.localise(frame, box)
            if other.confidence > max(best.confidence, least):
                best = other
        return best

    def as_at_first(self) -> Self:
        """The track with the translation filter of its first frame alone."""
        if self.translation is None:
            return self
        return replace(
            self, translation=self.translation._replace(running=self.translation.first_frame)
        )

    def update(self, cells: Floats, frame: np.ndarray) -> Floats:
        """Learn the object from the window around the present box, but for its template.

        cells: [Gy, Gx], of that window.
        Returns the label noise of the box and of the four corners, [5].
        """
        settings = self.catching_up()
        responses = self.training_samples(cells, frame.shape)
        self.update_weak(responses)
        noise = self.select(responses)
        if self.translation and settings.translation:
            self.translation = translation.update(
                self.translation, cells, settings.translation, settings.grid
            )
        colours = self.colours(frame, self.box)
        if self.colour and colours is not None:
            self.colour = colour.update(self.colour, colours, self.box, settings)
        if self.scale and settings.scale:
            self.scale = scale.update(self.scale, self.describe(cells, HERE), settings.scale)
        return noise

    def catching_up(self) -> Settings:
        """Settings by which a frame counts for those before it, too, that were not learned from."""
        settings = self.settings
        frames = 1 + (self.verification.num_rested if self.verification else 0)
        groups = {}
        for name in ("translation", "colour", "scale"):
            group = getattr(settings, name)
            if group:
                rate = 1 - (1 - group.learning_rate) ** frames
                groups[name] = replace(group, learning_rate=rate)
        return replace(settings, **groups)

    def rests(self, best: Candidate) -> bool:
        """Whether classifiers and filters do not learn from the frame of this candidate."""
        state, settings = self.verification, self.settings.verification
        if state is None or settings is None:
            return False
        return verification.may_rest(state, best.confidence, settings)

    def keep_up(self, best: Candidate) -> None:
        """Be where the candidate is, and learn the templates alone."""
        state, settings = self.verification, self.settings.verification
        assert state
        assert settings
        self.box, self.rotation = best.box, best.rotation
        self.verification, _, _ = verification.update(
            state, best.description, best.box, True, settings
        )

    def verify(self, cells: Floats, updated: Self, best: Candidate) -> float:
        """Become the updated track only if the object is verified well enough to be learned.

        The box is that of the candidate all the same. Returns the confidence.

        cells: [Gy, Gx], of the window around the candidate.
        """
        state, settings = self.verification, self.settings.verification
        assert state
        assert settings
        description = own_scale(self.describe(cells, HERE))
        state, confidence, learn = verification.update(
            state, description, updated.box, False, settings
        )
        if learn:
            self.become(updated)
        self.box, self.rotation = best.box, best.rotation
        self.verification = state
        return confidence

    def is_lost(self) -> bool:
        """Whether the object is lost; never without verification."""
        settings = self.settings.verification
        if self.verification and settings:
            return verification.is_lost(self.verification, settings)
        return False

    def output(self, box: Floats) -> Floats:
        """The box [4] that is reported: as estimated, or of the initial size around its centre."""
        centre, size = box[:2] + box[2:] / 2, box[2:]
        if self.settings.output_size == "initial":
            size = self.initial_size
        box = np.concatenate([centre - size / 2, size])
        return rotation.hull(box, self.angle) if self.angle else box

    def training_samples(self, cells: Floats, frame_shape: tuple[int, ...]) -> Floats:
        """Values [F, L] of all features on the training samples in the window around the box."""
        positions = training_positions(self.box, frame_shape, self.settings)
        return training_responses(cells, positions, self.pool, self.settings.grid)

    def update_weak(self, responses: Floats) -> None:
        """One update of all weak classifiers, and the count of right and wrong votes after it.

        responses: [F, L].
        """
        self.means, self.sigma, self.variance = weak.kalman_update(
            responses, LABELS, self.means, self.sigma, self.variance
        )
        predicted = weak.votes(responses, self.means, self.sigma)
        self.correct, self.wrong = weak.count(predicted, LABELS, self.correct, self.wrong)

    def select(self, responses: Floats) -> Floats:
        """Every selector chooses from its pool by the votes on these samples, [F, L].

        Returns the label noise of the box and the four corners, [5].
        """
        settings = self.settings
        pools = (settings.parts, settings.selectors, settings.pool_size)
        predicted = weak.votes(responses, self.means, self.sigma)
        phi = np.swapaxes(predicted.reshape(*pools, len(LABELS)), -1, -2)  # [K, N, L, M]
        errors = weak.error(self.correct, self.wrong)
        noise = np.zeros(5)
        match settings.selector:
            case "l1":
                by_selector = errors.reshape(pools) if settings.tie == "error" else None
                self.selected = selection.select_l1(
                    phi, LABELS, settings.lam, settings.iterations, by_selector
                )
                noise = selection.label_noise(phi, LABELS, settings.lam, settings.iterations)
            case "error":
                self.selected = selection.select_error(errors.reshape(pools))
            case "first":
                self.selected = selection.select_first(phi, LABELS)
            case "mil":
                self.selected = selection.select_mil(phi, LABELS)
        self.alpha = strong.voting_weight(errors[self.selected_features()])
        return noise

    def selected_features(self) -> Integers:
        """Index [K, N] in the pool of all F features of what each selector has chosen."""
        settings = self.settings
        first_of_pool = np.arange(settings.parts * settings.selectors) * settings.pool_size
        return first_of_pool.reshape(self.selected.shape) + self.selected

    def window(self, frame: np.ndarray, box: Floats) -> Floats:
        """The cells [Gy, Gx] of the window around a box."""
        shown = shown_box(box, self.settings)
        cells = window_cells(frame, shown, self.settings.grid)
        if self.angle == 0:
            return cells
        return rotation.turned_cells(cells, self.angle, cell_aspect(box, self.settings))

    @property
    def angle(self) -> float:
        """By which the canvas is turned."""
        return self.rotation.angle if self.rotation else 0.0

    def colours(self, frame: np.ndarray, box: Floats) -> np.ndarray | None:
        """The colours in the window around a box; None of a grey frame, or where none are asked."""
        if self.settings.colour is None:
            return None
        return colour.window_colours(frame, box, self.settings, self.angle)

    def describe(self, cells: Floats, displacement: Floats) -> Floats:
        """The patch there at S scales, or at its own if there is no scale filter: [S, D]."""
        return describe_scales(
            cells, displacement, scale.factors(self.settings.scale), self.settings.grid
        )

    def polar(self, cells: Floats, displacement: Floats, box: Floats) -> Floats:
        """What the rotation filter sees there, [D, A], in the window around a box."""
        of_cell = cell_aspect(box, self.settings)
        return rotation.polar(cells, displacement, of_cell, self.settings.grid)

    def become(self, other: Self) -> None:
        """Take over all that another track remembers."""
        vars(self).update(vars(other))


def own_scale(descriptions: Floats) -> Floats:
    """The description [D] at the present scale, the middle one of [S, D]."""
    return descriptions[len(descriptions) // 2]
