"""placeholder"""


def write(rows, page, figure):
    pass
