"""The page in the browser on which boxes are drawn, watched and corrected: `dcs-jax label`.

What is in which file:

    clip.py      any frame of a clip at once; index.py and reader.py do it for videos
    opening.py   a clip and its project
    session.py   one project that is worked on: edits, saving, who is told
    tracking.py  what is pending is tracked meanwhile
    guard.py     who may come in
    app.py       the server: what is at which address
    page/        HTML, CSS and JavaScript, as they are sent
"""
