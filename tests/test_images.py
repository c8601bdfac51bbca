"""Images as people have them: turned, deep, hidden, oddly named."""

import cv2
import numpy as np
import pytest
from PIL import Image, ImageOps

from dcs_jax.io.frames import open_source
from dcs_jax.io.image_bytes import image_size
from dcs_jax.io.images import natural

ORIENTATION = 0x0112


@pytest.fixture(scope="module")
def picture():
    coarse = np.random.default_rng(0).integers(0, 255, (6, 9, 3)).astype(np.uint8)
    return cv2.resize(coarse, (72, 48), interpolation=cv2.INTER_NEAREST)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", ["jpg", "png", "webp", "tif"])
def test_an_image_is_shown_as_its_exif_says(tmp_path, picture, suffix, orientation):
    path = tmp_path / f"0.{suffix}"
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    options = {
        "jpg": {"exif": exif, "quality": 100, "subsampling": 0},
        "png": {"exif": exif},
        "webp": {"exif": exif, "lossless": True},
        "tif": {"tiffinfo": {ORIENTATION: orientation}},
    }
    Image.fromarray(picture).save(path, **options[suffix])
    with Image.open(path) as image:
        expected = np.asarray(ImageOps.exif_transpose(image))
    source = open_source(tmp_path)
    (shown,) = source
    assert source.shape == shown.shape == expected.shape
    assert image_size(path) == expected.shape[:2]
    assert np.abs(shown.astype(int) - expected).mean() < 5


def test_images_that_are_turned_differently_have_different_sizes(tmp_path, picture):
    for number, orientation in enumerate((1, 6)):
        exif = Image.Exif()
        exif[ORIENTATION] = orientation
        Image.fromarray(picture).save(tmp_path / f"{number}.jpg", exif=exif)
    with pytest.raises(ValueError, match=r"1\.jpg has 48 x 72 pixels.* 72 x 48"):
        open_source(tmp_path)


@pytest.mark.parametrize(
    "tiff", [b"", b"MM\x00*", b"II*\x00\xff\xff\xff\xff", b"II*\x00" + bytes(9)]
)
def test_exif_that_is_damaged_turns_nothing(tmp_path, picture, tiff):
    jpeg = cv2.imencode(".jpg", picture)[1].tobytes()
    body = b"Exif\x00\x00" + tiff
    segment = b"\xff\xe1" + (len(body) + 2).to_bytes(2) + body
    (tmp_path / "0.jpg").write_bytes(jpeg[:2] + segment + jpeg[2:])
    assert open_source(tmp_path).shape == picture.shape


def test_fill_bytes_before_a_marker(tmp_path, picture):
    jpeg = cv2.imencode(".jpg", picture)[1].tobytes()
    (tmp_path / "0.jpg").write_bytes(jpeg[:2] + b"\xff\xff\xff" + jpeg[2:])
    source = open_source(tmp_path)
    assert source.shape == picture.shape
    assert len(list(source)) == 1


# The range of values in which a camera of so many bits gives the grey values 0 to 255.
DEPTHS = {
    "8 in 16 bits": (0, 255),
    "10 bits": (0, 1023),
    "12 bits": (0, 4095),
    "14 bits": (100, 16383),
    "16 bits": (0, 65535),
    "thermal": (8000, 8255),
}


@pytest.mark.parametrize("suffix", ["png", "tif", "jp2", "pgm"])
@pytest.mark.parametrize("depth", DEPTHS)
def test_deep_images_are_scaled_by_the_range_of_the_folder(tmp_path, picture, suffix, depth):
    low, high = DEPTHS[depth]
    ramp = np.linspace(0, 255, 48 * 72).reshape(48, 72)
    images = [ramp, ramp[::-1], np.full((48, 72), 128.0)]
    for number, image in enumerate(images):
        deep = np.rint(low + image * (high - low) / 255).astype(np.uint16)
        cv2.imwrite(str(tmp_path / f"{number}.{suffix}"), deep)
    source = open_source(tmp_path)
    for shown, image in zip(source, images, strict=True):
        assert np.abs(shown[..., 0] - image).max() < 3
    (note,) = source.notes
    assert "holds 16-bit images: their values" in note
    assert note.endswith("are taken as 0 to 255")


@pytest.mark.parametrize("dtype", [np.uint16, np.int16, np.float32])
@pytest.mark.parametrize("channels", [1, 3])
def test_tiff_of_any_type(tmp_path, picture, dtype, channels):
    values = 1000 + 3 * picture.astype(np.float32)
    stored = values[..., 0] if channels == 1 else values[..., ::-1]
    cv2.imwrite(str(tmp_path / "0.tif"), stored.astype(dtype))
    (shown,) = open_source(tmp_path)
    assert shown.dtype == np.uint8
    expected = picture if channels == 3 else picture[..., :1].repeat(3, 2)
    low, high = expected.min(), expected.max()
    stretched = (expected.astype(float) - low) * 255 / (high - low)
    assert np.abs(shown - stretched).mean() < 2


def test_a_broken_pixel_does_not_make_the_range(tmp_path):
    deep = np.linspace(500, 700, 200 * 200).reshape(200, 200).astype(np.uint16)
    deep[100, 100] = 65535
    cv2.imwrite(str(tmp_path / "0.png"), deep)
    (shown,) = open_source(tmp_path)
    assert shown.max() - shown.min() == 255
    assert np.abs(np.median(shown) - 128) < 4


def test_transparency_is_left_out(tmp_path, picture):
    for number, suffix in enumerate(("png", "webp")):
        folder = tmp_path / suffix
        folder.mkdir()
        opaque = np.full((*picture.shape[:2], 1), 40 * number, np.uint8)
        Image.fromarray(np.concatenate([picture, opaque], 2)).save(
            folder / f"0.{suffix}",
            **({"lossless": True, "exact": True} if suffix == "webp" else {}),
        )
        (shown,) = open_source(folder)
        np.testing.assert_array_equal(shown, picture)


def test_hidden_files_and_folders_are_no_images(tmp_path, picture):
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), picture)
        (tmp_path / f"._{number}.png").write_bytes(b"\x00\x05\x16\x07")
    (tmp_path / "mask.png").mkdir()
    (tmp_path / ".thumbnails").mkdir()
    assert open_source(tmp_path).length == len(list(open_source(tmp_path))) == 3


@pytest.mark.parametrize(
    "names",
    [
        ("-20.png", "-3.png", "0.png", "+7.png", "9.5.png", "10.05.png"),
        ("img2.png", "img-9.png", "img-10.png"),
        ("2024-9-1.png", "2024-11-14.png"),
        ("1.2.9.png", "1.2.10.png", "1.10.1.png"),
        ("1305031102.175304.png", "1305031102.2.png", "1305031103.png"),
        ("t=-20.png", "t=-5.png", "t=3.png"),
        ("a_-20.png", "a_5.png"),
        ("00005.png", "10.png"),
        ("1.png", "a2b10.png", "a10b1.png"),
    ],
)
def test_numbers_in_names_sort_as_numbers(names):
    assert sorted(set(names), key=natural) == list(names)


def test_a_pattern_names_some_images_of_a_folder(tmp_path, picture):
    for name in ("img_0001.png", "img_0002.png", "img_10.png", "mask_0001.png", "img_0003.jpg"):
        cv2.imwrite(str(tmp_path / name), picture)
    assert open_source(tmp_path / "img_%04d.png").length == 3
    assert open_source(tmp_path / "mask_%d.png").length == 1
    with pytest.raises(ValueError, match="no images with a name like frame_%04d"):
        open_source(tmp_path / "frame_%04d.png")
