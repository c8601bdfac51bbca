"""The paper as pure functions of arrays, in its order.

window     the search window around the last box               Algorithm 1, line 1
search     the confidence map over the window, and its peak    lines 2 and 3
samples    the object's parts, and the training samples        line 4
haar       Haar-like features: random pools, and responses
weak       weak classifiers: update, votes, errors             Algorithm 2, eq. 16
selection  the weak classifier that each selector chooses      Algorithm 2, eq. 14 and 15
strong     strong part classifiers                             Algorithm 2
"""
