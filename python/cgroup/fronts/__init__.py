"""Checked clouds (`scan`), their keypoints and descriptors (`paper_front`), and matches (`matching`)."""
