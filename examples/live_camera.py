"""Follow a box in what a camera, a network stream or a file shows, frame by frame.

python examples/live_camera.py SOURCE X,Y,W,H      a number is a camera
"""

import argparse

import cv2

import dcs_jax


def main(source: str, box: list[float], config: dcs_jax.Config = dcs_jax.Config()) -> int:
    """Print the box of every frame; returns their number."""
    capture = cv2.VideoCapture(int(source) if source.isdigit() else source)
    tracker = dcs_jax.Tracker(config, order="bgr")  # as OpenCV gives them
    frames = 0
    while (read := capture.read())[0]:
        frame = read[1]
        if frames == 0:
            tracker.init(frame, box)
        else:
            held, (x, y, w, h) = tracker.update(frame)
            print(f"{frames}: {x:.0f},{y:.0f} {w:.0f}x{h:.0f}{'' if held else ' lost'}")
        frames += 1
    capture.release()
    return frames


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("source")
    parser.add_argument("box", type=lambda text: [float(side) for side in text.split(",")])
    arguments = parser.parse_args()
    main(arguments.source, arguments.box)
