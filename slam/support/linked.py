"""A function's code is optimised once: where it is linked into what Python calls.

Numba optimises each function and makes machine code of it; links it into what calls it, and optimises it there once
more, and so on in all callers of these. Of functions that Python never calls nothing but the linked copies runs. So
they are only tidied here, and handed on: what an episode needs is compiled in three fifths of the time, is as fast,
and has the same results to the bit (see the results on speed).

While they are compiled numba is also spared what nobody needs: C's way into its own functions, these functions once
more for callers whose options differ in what does not reach them, and passes for what no loop here has.

That goes by private parts of numba, which may be others in another version. Two small functions are compiled first,
to see that it works; if not, all is compiled as numba does it.

Left out: functions that call each other in turn, which need machine code of their own.
"""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
from typing import Any

import llvmlite.binding as llvm
from numba.core import codegen, targetconfig, typed_passes, types, untyped_passes
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher, cpu_target
from numba.core.typing import templates

#: How names of functions begin that unpack arguments from Python, and of variables for addresses of environments.
_FROM_PYTHON, _ENVIRONMENT = "_ZN7cpython", "_ZN08NumbaEnv"
#: LLVM's level of optimisation for what is optimised again after it was linked.
_TIDY = 1
#: Passes for what no loop here has: blocks of `with`, `literally`, `literal_unroll`, functions that ask to be inlined.
_UNNEEDED = {
    (untyped_passes, "WithLifting"),
    (untyped_passes, "InlineInlinables"),
    (untyped_passes, "FindLiterallyCalls"),
    (untyped_passes, "LiteralUnroll"),
    (untyped_passes, "LiteralPropagationSubPipelinePass"),
    (typed_passes, "InlineOverloads"),
}

_Code: Any = getattr(codegen, "JITCodeLibrary", object)


class LinkedCode(_Code):  # type: ignore[misc]
    """Code that becomes machine code only if Python can call it."""

    _final_module: Any

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout
        passes, builder = self._codegen._function_pass_manager(opt=_TIDY)
        for function in ll_module.functions:
            if not function.is_declaration:
                passes.run(function, builder)

    def _optimize_final_module(self) -> None:
        if self._is_called():
            super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        # What comes from disk has machine code, be it of an empty module.
        if getattr(self, "_compiled_object", None) is None and not self._is_called():
            whole, self._finalized = self._final_module, True
            self._get_module_for_linking()  # which it keeps
            self._finalized = False
            # Numba looks in machine code for the places of environments.
            places = [str(one) for one in whole.global_variables if one.name.startswith(_ENVIRONMENT)]
            self._final_module = llvm.parse_assembly("\n".join(places))
            self._final_module.name = whole.name
            self._final_module.triple, self._final_module.data_layout = whole.triple, whole.data_layout
        super()._finalize_final_module()

    def _is_called(self) -> bool:
        """Whether Python can call it."""
        return any(
            one.name.startswith(_FROM_PYTHON) and not one.is_declaration
            for one in self._final_module.functions
        )


class OptimisedOnce(Compiler):
    """Numba's compiler, what it makes being `LinkedCode` where numba has the parts for that."""

    def define_pipelines(self) -> Any:
        """Numba's passes, but for those that would find nothing to do."""
        own: Any = super().define_pipelines
        managers = own()
        unneeded = {getattr(module, name, None) for module, name in _UNNEEDED}
        for manager in managers:
            manager.passes = [one for one in manager.passes if one[0] not in unneeded]
            manager.finalize()
        return managers

    def compile_extra(self, func: Any) -> Any:
        """Compile a function."""
        compiled: Any = super().compile_extra
        with _linked() if works() else nullcontext():
            return compiled(func)


@cache
def works() -> bool:
    """Whether numba has the parts that are used here: a function that calls another returns what it should."""
    parts = {"nopython": True, "no_cpython_wrapper": True, "error_model": "numpy"}
    inner: Any = CPUDispatcher(lambda x: 2.0 * max(x, 0.0), {}, parts)
    outer: Any = CPUDispatcher(lambda x: inner(x) + 1.0, {}, {**parts, "no_cpython_wrapper": False})
    try:
        with _linked():
            compiled = outer.compile((types.float64,))
        [made] = outer.overloads.values()
        wrapper = made.fndesc.llvm_cpython_wrapper_name
        return bool(made.library.get_pointer_to_function(wrapper)) and compiled(20.0) == 41.0
    except Exception:  # whatever it is, numba's own way does without
        return False


@contextmanager
def _linked() -> Iterator[None]:
    """What is compiled inside of the block is `LinkedCode`; the compiler's lock is held."""
    context: Any = cpu_target.target_context
    numbas: Any = templates._OverloadFunctionTemplate
    context.refresh()  # which compiles numba's own runtime, as Python calls it
    target = context.codegen()
    before = target._library_class, numbas._get_impl, context.create_cfunc_wrapper
    target._library_class, numbas._get_impl = LinkedCode, _implementation
    context.create_cfunc_wrapper = _none
    try:
        yield
    finally:
        target._library_class, numbas._get_impl, context.create_cfunc_wrapper = before


def _implementation(template: Any, args: Any, kws: Any) -> Any:
    """What numba itself has for a function and types of arguments, compiled where it was not yet.

    Numba keeps one for each set of the caller's options, where it depends on four of them alone.
    """
    options = targetconfig.ConfigStack.top_or_none()
    told = None
    if options is not None:
        math = frozenset(options.fastmath.flags)
        told = (options.nrt, math, options.error_model, options.forceinline)
    key = template.context, tuple(args), tuple(kws.items()), told
    if key in template._impl_cache:
        return template._impl_cache[key]
    return template._build_impl(key, args, kws)


def _none(*args: Any) -> None:
    """Nothing is called from C."""
