"""A subject's voxels in three linked planes, with contours over them."""
