"""How numba compiles a function that only ever becomes part of kernels: no further than to LLVM's language.

Numba would optimise it and translate it to machine code by itself, as if it were called from Python, and then optimise
it again wherever it is linked into: a sixth of all the compilation.
"""

from __future__ import annotations

from typing import Any

from numba._dynfunc import make_function
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.typed_passes import NativeLowering


class PartCompiler(CompilerBase):
    """Numba's pipeline but for its last step."""

    def define_pipelines(self) -> list[PassManager]:
        found = DefaultPassBuilder.define_nopython_pipeline(self.state)
        found.passes = [(PartLowering if step is NativeLowering else step, text) for step, text in found.passes]
        found.finalize()
        return [found]


class PartLibrary(JITCodeLibrary):
    """A function with all that it calls, to be linked into others."""

    def add_llvm_module(self, ll_module: Any) -> None:
        self._final_module.link_in(ll_module)

    def finalize(self) -> None:
        for library in dict.fromkeys(self._linking_libraries):
            # Numba 0.61 has none yet.
            getattr(self, "_reload_init", set()).update(getattr(library, "_reload_init", ()))
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True


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
