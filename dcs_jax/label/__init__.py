"""The page in the browser on which boxes are drawn, watched and corrected: `dcs-jax label`.

    clip.py      any frame of a clip at once
    session.py   one project that is worked on: edits, tracking, saving, who is told
    tracking.py  the thread that tracks what is pending
    app.py       the server: addresses, who may come in, the web socket
    page/        HTML, CSS and JavaScript, as they are sent
"""
