"""What the default tracker has beyond the paper, a file a component.

    translation.py   correlation filter over positions: one more cue in the score map
    colour.py        histograms of the colours of object and background: another one
    scale.py         correlation filter over scales: the size of the box
    aspect.py        similarity to the first template: an object that gets narrower or flatter
    rotation.py      correlation filter over angles: by how much the object has turned
    verification.py  similarity to templates: confidence, learning only where verified, lost
    redetection.py   search windows all over the frame for an object that was missed

They rest on filters.py (ridge regression in the Fourier domain), descriptors.py (a patch as a unit
vector) and gradients.py (the features of both). A component has a group of settings in `Config`,
mostly a field of `State`, and the verbs init, score, estimate or follow, and update; None switches
it off.
"""
