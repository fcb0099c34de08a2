"""How numba compiles kernels and the functions that only ever become part of them: without steps that they do not need.

Numba would optimise a part and translate it to machine code by itself, as if it were called from Python, and then
optimise it again wherever it is linked into; and optimise each function of a kernel in full before all are, as one.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from llvmlite.binding.newpassmanagers import ModulePassManager
from numba._dynfunc import make_function
from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.typed_passes import NativeLowering
from numba.core.typing.templates import _OverloadFunctionTemplate

UNUSED_STEPS = frozenset({
    "WithLifting", "InlineClosureLikes", "MakeFunctionToJitFunction", "RewriteSemanticConstants", "DeadBranchPrune",
    "RewriteDynamicRaises", "InlineInlinables", "InlineOverloads", "FindLiterallyCalls", "LiteralUnroll",
    "LiteralPropagationSubPipelinePass", "DumpParforDiagnostics", "NopythonRewrites",
})  # fmt: skip
"""For `with`, closures and comprehensions, `raise` with values, branches on None, `inline="always"`, and loops over
tuples of several types: a function that has one of these is not compiled, an error says so. The last is for sums of
whole arrays, each of which would take a loop and an array of its own: kernels go through their arrays by themselves."""


class KernelLibrary(JITCodeLibrary):
    """Machine code of a function with all that it calls: made short one by one, optimised as a whole only."""

    def add_llvm_module(self, ll_module: Any) -> None:
        """Variables become values before the function is copied to where it is called: most of its code is gone."""
        if hasattr(ModulePassManager, "add_sroa_pass"):  # numba 0.61 has none yet
            passes = ModulePassManager()
            passes.add_sroa_pass()
            passes.add_simplify_cfg_pass()
            passes.add_instruction_combine_pass()
            passes.run(ll_module, self._codegen._pass_builder())
        self._final_module.link_in(ll_module)


class PartLibrary(KernelLibrary):
    """A function alone: whatever calls it is linked with what it calls, too (`link_each_part_once`)."""

    def finalize(self) -> None:
        for function in self._final_module.functions:
            if not function.is_declaration:
                function.linkage = "linkonce_odr"  # into each kernel its own
        self._shared_module = self._final_module
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class KernelLowering(NativeLowering):
    _name = "kernel_lowering"

    def run_pass(self, state: Any) -> bool:
        state.library = KernelLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()  # that it can be kept
        return super().run_pass(state)


@register_pass(mutates_CFG=True, analysis_only=False)
class PartLowering(NativeLowering):
    _name = "part_lowering"

    def run_pass(self, state: Any) -> bool:
        state.library = PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        changed = super().run_pass(state)
        lowered, name = state.cr, state.func_id.func_name
        entry = make_function(lowered.fndesc.lookup_module(), name, "", 0, lowered.env, (state.library,))
        state.targetctx.insert_user_function(entry, lowered.fndesc, [state.library])
        state.cr = lowered._replace(cfunc=entry)
        return changed


class KernelCompiler(CompilerBase):
    """Numba's pipeline without the steps for what no kernel has."""

    lowering: type[NativeLowering] = KernelLowering
    unused: frozenset[str] = UNUSED_STEPS

    def define_pipelines(self) -> list[PassManager]:
        found = DefaultPassBuilder.define_nopython_pipeline(self.state)
        steps = [(step, text) for step, text in found.passes if step.__name__ not in self.unused]
        found.passes = [(self.lowering if step is NativeLowering else step, text) for step, text in steps]
        found.finalize()
        return [found]


class PartCompiler(KernelCompiler):
    """No further than to LLVM's language."""

    lowering = PartLowering


class OverloadCompiler(PartCompiler):
    """For what numba writes in Python itself (`np.empty`), of which each kernel has its own: with all steps."""

    unused = frozenset()


def overloads_become_parts() -> None:
    """Has numba compile what it writes in Python itself, from now on, as parts."""
    template: Any = _OverloadFunctionTemplate
    plain = template._get_jit_decorator
    template._get_jit_decorator = lambda self: partial(plain(self), pipeline_class=OverloadCompiler)


def link_each_part_once() -> None:
    """Has numba link what a part calls beside it: within it, it would be copied again for each that calls the part."""
    library: Any = CPUCodeLibrary
    plain = library.add_linking_library

    def add_linking_library(self: Any, added: Any) -> None:
        plain(self, added)
        if isinstance(added, PartLibrary):
            self._linking_libraries = list(dict.fromkeys((*self._linking_libraries, *added._linking_libraries)))

    library.add_linking_library = add_linking_library
