"""An independent reference of the tracker: float64 NumPy, plain loops, in the order of the papers.

    Chen and Wang, "Robust Visual Tracking Using Dynamic Classifier Selection with Sparse
    Representation of Label Noise", ACCV 2012: haar to tracker
    Danelljan et al., "Accurate Scale Estimation for Robust Visual Tracking", BMVC 2014: filters,
    translation, scale
    Possegger et al., "In Defense of Color-Based Model-Free Tracking", CVPR 2015, and Bertinetto et
    al., "Staple: Complementary Learners for Real-Time Tracking", CVPR 2016: colour
    Dalal and Triggs, "Histograms of Oriented Gradients for Human Detection", CVPR 2005: gradients

It is written from the description, not from the JAX code, and knows nothing of it; one idea a
function, so that each can be compared. The features are passed in. A component beyond the paper is
a module, the functions of the paper's own part stand here.
"""

from . import (
    aspect,
    colour,
    descriptors,
    filters,
    gradients,
    redetection,
    rotation,
    scale,
    translation,
    verification,
)
from .haar import Box, boxes_of, cell_weights, haar_map, haar_response, parts_of
from .records import (
    AspectRatio,
    Candidate,
    ColourHistograms,
    Grid,
    Maps,
    Pool,
    Redetection,
    RotationFilter,
    ScaleFilter,
    Settings,
    StepInfo,
    TranslationFilter,
    Verification,
)
from .samples import LABELS, reachable, training_positions, training_responses
from .search import (
    move,
    nearest_position,
    parabola_peak,
    peak,
    squared_distances,
    with_motion_prior,
)
from .selection import (
    bag_log_likelihood,
    first_best,
    label_noise,
    select_error,
    select_first,
    select_l1,
    select_mil,
)
from .solver import duality_gap, fista, huber_objective, objective, solve_exactly
from .strong import part_probabilities, score_map, smooth, strong_map, voting_weight
from .tracker import Tracker
from .weak import (
    count,
    error,
    first_sigma,
    kalman_update,
    vote_gaussian,
    vote_midpoint,
    votes,
)
from .window import cell_aspect, cell_means, grey, integral, shown_box, turned, window_cells

__all__ = [
    "LABELS",
    "AspectRatio",
    "Box",
    "Candidate",
    "ColourHistograms",
    "Grid",
    "Maps",
    "Pool",
    "Redetection",
    "RotationFilter",
    "ScaleFilter",
    "Settings",
    "StepInfo",
    "Tracker",
    "TranslationFilter",
    "Verification",
    "aspect",
    "bag_log_likelihood",
    "boxes_of",
    "cell_aspect",
    "cell_means",
    "cell_weights",
    "colour",
    "count",
    "descriptors",
    "duality_gap",
    "error",
    "filters",
    "first_best",
    "first_sigma",
    "fista",
    "gradients",
    "grey",
    "haar_map",
    "haar_response",
    "huber_objective",
    "integral",
    "kalman_update",
    "label_noise",
    "move",
    "nearest_position",
    "objective",
    "parabola_peak",
    "part_probabilities",
    "parts_of",
    "peak",
    "reachable",
    "redetection",
    "rotation",
    "scale",
    "score_map",
    "select_error",
    "select_first",
    "select_l1",
    "select_mil",
    "shown_box",
    "smooth",
    "solve_exactly",
    "squared_distances",
    "strong_map",
    "training_positions",
    "training_responses",
    "translation",
    "turned",
    "verification",
    "vote_gaussian",
    "vote_midpoint",
    "votes",
    "voting_weight",
    "window_cells",
    "with_motion_prior",
]
