"""What numba compiles for itself (it counts references to arrays), kept from one start to the next.

Numba does so in each process, before its first kernel. Where all kernels are kept nothing else needs LLVM's optimiser
and code generator: 27 MB of it that are not loaded then, and a tenth of a second of each start.
"""

from __future__ import annotations

import pickle
from typing import Any

from numba.core.runtime import nrtdynmod

from ispom import kept_code


def keep_runtime() -> None:
    """Has numba look for it among the kept code first."""
    nrtdynmod.compile_nrt_functions = _compiled


def _compiled(context: Any) -> Any:
    """Numba's library of it, in place of `nrtdynmod.compile_nrt_functions`."""
    codegen, folder = context.codegen(), kept_code.folder()
    if folder is None:
        return _compiled_anew(context)
    name = f"numba.runtime-{kept_code.digest(kept_code.made_for(codegen)).hex()}{kept_code.SUFFIX}"
    found = kept_code.loaded(folder / name, codegen.unserialize_library)
    if found is None:
        found = _compiled_anew(context)
        kept_code.save(folder / name, pickle.dumps(found.serialize_using_object_code()))
    return found


def _compiled_anew(context: Any) -> Any:
    module, library = nrtdynmod.create_nrt_module(context)
    library.enable_object_caching()
    library.add_ir_module(module)
    library.finalize()
    return library
