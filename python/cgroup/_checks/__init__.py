"""Checks of arguments: values, arrays, fields of correspondences, clouds of other libraries."""
