"""Compiled code: how kernels are compiled and kept, arrays they borrow, lanes and threads, three-vectors.

This room alone leans on the inside of numba and llvmlite, piece by piece, each for a reason: ``python
benchmarks/kernels.py PIECE`` replaces one by the plain public way, which is what to do if a new numba breaks
its test. What a piece pays is what the plain way costs more: measured with numba 0.68.1 and llvmlite 0.50.0
on an AMD EPYC (Zen 5), medians of 3 to 9 processes; a piece that pays less than 5 % goes.

linked: a kernel that kernels call is linked into them, no machine code of its own (``_Callee``, ``_Linked``,
    ``_IntoCallers``, ``_Kernel``: subclasses of ``CPUDispatcher``, ``Compiler``, ``JITCodeLibrary``). Pays
    110 % of the CPU time of a cold compile, with ``forceinline=True`` where inlined, an option numba documents;
    the benchmark leaves that out too: 71 %, and a row of RK4 takes five times as long.
    ``test_what_kernels_call_is_no_machine_code_before_python_calls_it``.
    Instead: drop ``get_call_template`` and ``get_overload``, give ``forceinline=True`` in ``_compiled``.
optimised: and it is optimised before it is linked (``JITCodeLibrary._optimize_final_module``). Pays 5 % of a
    row of RK4 or of the env; numba's own two passes there would cost 20 % of a cold compile.
    ``test_what_kernels_call_is_no_machine_code_before_python_calls_it``. Instead: nothing.
gc_off: no search for garbage during compilation (``CPUDispatcher.compile``). Pays 12 % of a cold compile.
    ``test_the_garbage_collector_rests_while_a_kernel_is_compiled_and_is_left_as_it_was``. Instead: drop
    ``_Kernel.compile``.
no_cfunc_wrapper: no second entry for C, an option that numba does not document. Pays 15 % of a cold compile.
    ``test_a_kernel_has_no_second_entry_for_c``. Instead: leave the option out.
borrowed: an array without its owner, from ``numba.carray`` and an ``intrinsic`` that casts ``array.ctypes``;
    both public, the cast (``context.cast``) is not. Pays 14 % of a row of the shield in batches.
    ``test_a_borrowed_array_has_no_owner``. Instead: the array itself.
one_row: the same with a leading axis. Pays 12 % of one call of the shield.
    ``test_what_is_carved_and_one_row_have_no_owner``. Instead: ``reshape``.
carved: the same out of memory that holds much. Pays 30 % of one call, 40 % of a row in batches.
    ``test_arrays_are_carved_out_of_one``. Instead: ``view``, a slice, ``view`` and ``reshape``.
wide_vectors: ``prefer-vector-width`` as an attribute of the LLVM function, past llvmlite's own ``add``. Pays
    40 to 60 % of a row of RK4 or of the env in code for an Intel Xeon, whose habit is 256 bits
    (``NUMBA_CPU_NAME=sapphirerapids``), nothing in code for Zen 5, whose habit is 512.
    ``test_wide_vectors_tells_llvm_and_changes_nothing_else``. Instead: nothing.
fma: llvmlite's ``fma`` in an ``intrinsic``. Pays 15 to 20 % of a row of RK4, 11 to 14 % of the env, and is
    part of the bits. ``test_fma_rounds_once``. Instead: ``a * b + c``, with other bits.
tiles: rows are transposed in registers (``context.make_array`` and llvmlite's shuffles). Pays 90 to 100 % of
    a row of RK4, 8 to 11 % of the env. ``test_rows_go_into_lanes_and_back``. Instead: the loop over entries.
aligned: memory from a cache line on, by the public ``array.ctypes.data``. Pays 4 to 7 % of both.
    ``test_rows_start_on_a_cache_line``. Instead: ``np.empty``.

Three pieces are there for what they do. ``entry_at`` answers with a record inside a tuple, which no compiled
function can (``intrinsic`` with ``context.get_function`` and ``make_tuple``;
``test_an_entry_of_two_arrays_is_counted_once``); else the array and the place are passed on.
``config.CACHE_DIR`` is set while a function is decorated: numba's own cache misses edits in other files
(``test_editing_a_callee_in_another_file_changes_the_caller``); else ``NUMBA_CACHE_DIR``, set before numba is
imported. ``disable_compile``, so that unchecked arguments are an error and no compilation
(``test_new_types_are_compiled_where_that_is_allowed_and_refused_elsewhere``); else signatures in the decorator.
"""
