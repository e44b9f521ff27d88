from ._filters import check_filter as check_filter
