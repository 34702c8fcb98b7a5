"""Makes docs/flight.gif, the moving picture of README: imu_uwb_yolo, seed 0, nine times as fast as it is flown.

    .venv/bin/python scripts/make_flight_gif.py

It is what `ortilo fly --video flight.gif` writes, every third frame of it, which keeps it below 3 MB.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

PICTURE = Path(__file__).parents[1] / "docs" / "flight.gif"
EVERY = 3
SHOWN = 130  # of a frame [ms]


def main() -> None:
    """Fly, keep every third frame, write the picture."""
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "flight.gif"
        subprocess.run([sys.executable, "-m", "ortilo_drake.cli", "fly", "--video", str(whole)], check=True)
        with Image.open(whole) as video:
            frames = []
            for number in range(0, video.n_frames, EVERY):
                video.seek(number)
                frames.append(video.convert("RGB"))
    palette = frames[len(frames) // 2].quantize(96, dither=Image.Dither.NONE)
    small = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    small[0].save(PICTURE, save_all=True, append_images=small[1:], duration=SHOWN, loop=0, optimize=False)
    print(f"{PICTURE}: {len(small)} frames, {PICTURE.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
