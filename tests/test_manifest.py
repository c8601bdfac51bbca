"""The list of what to track, and errors that name the line and column."""

import pytest

from dcs_jax.jobs.manifest import Target, group_by_video, read_manifest


def write(folder, text):
    path = folder / "manifest.csv"
    path.write_text(text, encoding="utf-8-sig")
    return path


def test_a_row_is_a_target(tmp_path):
    path = write(
        tmp_path,
        'source,box,start,end,id\n/a/b.mp4,"1,2,30,40.5",7,9,"one, two"\n\nc,1 2 30 40,,,\n',
    )
    assert read_manifest(path) == [
        Target("one, two", "/a/b.mp4", (1, 2, 30, 40.5), 7, 9),
        Target("2", str(tmp_path / "c"), (1, 2, 30, 40)),
    ]


def test_sides_may_have_columns_and_counts_may_be_floats(tmp_path):
    """As pandas writes a column of whole numbers with a gap."""
    path = write(tmp_path, "end,x,y,w,h,source\n8.0,-1,2,30,40,../c\n,1,2,4,4,../c\n")
    source = str(tmp_path.parent / "c")
    assert read_manifest(path) == [
        Target("1", source, (-1, 2, 30, 40), 0, 8),
        Target("2", source, (1, 2, 4, 4)),
    ]


def test_the_targets_of_a_source_are_one_video(tmp_path):
    rows = 'a,"1,2,30,40"\nb,"1,2,30,40"\n./a,"1,2,30,40"\n'
    videos = group_by_video(read_manifest(write(tmp_path, f"source,box\n{rows}")))
    assert [[target.id for target in video.targets] for video in videos] == [["1", "3"], ["2"]]


HEAD = "source,box,start,end,id\n"
GOOD = 'a,"1,2,30,40",0,9,one\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: the column source is missing"),
        (HEAD, "has no rows"),
        ("source,x,y,w\n", "line 1: the column h is missing"),
        ("source,box,ende\n", "line 1: there is no column 'ende'"),
        ("source,box,x\n", "line 1: there is no column 'x'"),
        ("source,box,box\n", "line 1 has the column box twice"),
        (HEAD + GOOD + "a,1,2,30,40,0,9,two\n", "line 3 has 8 cells, but there are 5 columns"),
        (HEAD + '"","1,2,30,40",0,9,one\n', "line 2, column source is '': expected a video"),
        (HEAD + 'a,"1,2,30",0,9,one\n', "line 2, column box is '1,2,30': expected four numbers"),
        (HEAD + 'a,"1,2,nan,4",0,9,one\n', "line 2, column box is '1,2,nan,4': expected finite"),
        (HEAD + 'a,"1,2,30,3",0,9,one\n', "line 2, column box is '1,2,30,3': expected w and h of"),
        ("source,x,y,w,h\na,1,2,x,4\n", "line 2, column w is 'x': expected a number"),
        ("source,x,y,w,h\na,1,2,9,-4\n", "line 2, column h is '-4': expected w and h of"),
        (HEAD + GOOD + 'a,"1,2,30,40",-1,9,two\n', "line 3, column start is '-1': expected"),
        (HEAD + 'a,"1,2,30,40",1.5,9,one\n', "line 2, column start is '1.5'"),
        (HEAD + 'a,"1,2,30,40",5,5,one\n', "line 2, column end is '5': expected a frame, 6 or"),
        (HEAD + GOOD + "\n" + GOOD, "line 4, column id is 'one': expected a name of its own, but"),
    ],
)  # fmt: skip
def test_errors_name_line_and_column(tmp_path, text, message):
    path = write(tmp_path, text)
    with pytest.raises(ValueError, match=r"manifest\.csv") as error:
        read_manifest(path)
    assert message in str(error.value)


def test_a_file_that_is_not_text(tmp_path):
    path = tmp_path / "manifest.csv"
    path.write_bytes(b'source,box\n\xff\xfe,"1,2,30,40"\n')
    with pytest.raises(ValueError, match=r"manifest\.csv, line \d is not CSV in UTF-8"):
        read_manifest(path)
    path.write_bytes(b'source,box,id\na,"1,2,30,40",\xff\n')
    with pytest.raises(ValueError, match=r"manifest\.csv, line \d is not CSV in UTF-8"):
        read_manifest(path)
