"""Arguments checked: values, arrays, fields of correspondences, clouds of other libraries."""
