"""Selection of classifiers by non-negative l1 minimisation: a library within the library.

Nothing here knows what a frame is. In the order to read them:

    problem             the selection problem, its objective, a bound on its curvature
    certificate         the objective and a lower bound of the minimum, for any coefficients
    iterate             the form of a method (init, step, solution), and the loop around one
    apg                 accelerated proximal gradient: the tracker's solver
    interior            a primal-dual interior point method: the solver for small gaps
    projected_gradient  the plain method, for comparison
    jaxopt              the proximal gradient of the package jaxopt, for comparison
    ties                which of several equally good classifiers is selected
    select              the public `select_classifiers`: checks, batches, choice of the solver

A solver is one file with a function `method(problem, start)`, and an entry in the table of
`select`.
"""
