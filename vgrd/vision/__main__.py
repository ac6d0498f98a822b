"""python -m vgrd.vision: compile the hot loops now, at installation, instead of at the first start."""

from vgrd.vision.tags.tag_finder import warm_up

warm_up()
