"""How scenes are pictured; commands' tests look at the pictures themselves."""

from harness.studies.pictures import uniform_grid


def test_the_grid_grows_with_the_scene():
    assert [uniform_grid(n).leaf for n in (1, 279_163, 9_388_826)] == [
        8,
        128,
        512 if 9_388_826 * 5 > 2**25.5 else 256,
    ]
