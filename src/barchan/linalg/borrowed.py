"""Arrays inside compiled kernels without reference counts.

A view such as `rows[i]` costs two atomic operations in Numba, as much as the arithmetic of a small block. The caller of a
kernel holds the arrays while it runs, so a kernel may drop the count of its arguments.
"""

from __future__ import annotations

from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array


@intrinsic
def borrowed(typing_context, array):  # type: ignore[no-untyped-def]
    """The same array, of which Numba does not count the references: views of it in a loop cost nothing."""

    def build(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        view = make_array(signature.args[0])(context, builder, arguments[0])
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        return view._getvalue()

    return array(array), build
