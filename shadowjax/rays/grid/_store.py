"""What the search keeps for every cell: the least key, or the least key with the face it belongs to."""

import jax
import jax.numpy as jnp
from jax import lax

from shadowjax._types import Array, Bool, Float, Int, UInt
from shadowjax.rays.grid._project import miss_key

# The least key alone; or one 64-bit word, key above face; or, for 64-bit keys, key and face.
Buffers = tuple[Array, ...]

_SHIFT = 32


def packs(dtype: jnp.dtype, with_face: bool) -> bool:
    """Whether key and face fit one word of 64 bits, whose order is that of hits: by key, then by face."""
    return with_face and dtype.itemsize == 4


def words(keys: Float[Array, "*cells"], faces: Int[Array, "*#cells"] | UInt[Array, "*#cells"]) -> Int[Array, "*cells"]:
    """One word for each hit, ordered like (key, face). The only 64-bit numbers here, whatever the user's setting."""
    bits = lax.bitcast_convert_type(keys, jnp.int32)
    # The bits of negative floats fall as the floats rise; turn them over, but for the sign.
    ordered = bits ^ ((bits >> 31) & jnp.int32(0x7FFFFFFF))
    with jax.enable_x64(True):
        return (lax.convert_element_type(ordered, jnp.int64) << jnp.int64(_SHIFT)) | lax.convert_element_type(
            lax.bitcast_convert_type(faces, jnp.uint32), jnp.int64
        )


def unpack(word: Int[Array, "*cells"]) -> tuple[Float[Array, "*cells"], Int[Array, "*cells"]]:
    """Keys and faces of words."""
    with jax.enable_x64(True):
        high, low = (
            lax.convert_element_type(word >> jnp.int64(_SHIFT), jnp.int32),
            lax.convert_element_type(word, jnp.int32),
        )
    bits = high ^ ((high >> 31) & jnp.int32(0x7FFFFFFF))
    return lax.bitcast_convert_type(bits, jnp.float32), low


def start(keys: Float[Array, "tiles lanes"], with_face: bool) -> Buffers:
    """Buffers that hold the limit of every cell and no face."""
    if not with_face:
        return (keys,)
    none = jnp.full(keys.shape, -1, jnp.int32)
    return (words(keys, none),) if packs(keys.dtype, True) else (keys, none)


def merge(
    buffers: Buffers, index: UInt[Array, ""], keys: Float[Array, "1 lanes"], inside: Bool[Array, "1 lanes"], face: Array
) -> Buffers:
    """Keep the nearer of what a tile holds and a triangle's hits in it; of equally near ones the lowest face.

    Keys alone, and words, are the lesser of two numbers. Key and face apart need a choice for both, and are slower.
    """
    keys = jnp.where(inside, keys, jnp.asarray(miss_key(keys.dtype), keys.dtype))
    at = index, jnp.uint32(0)

    def read(buffer: Array) -> Array:
        return lax.dynamic_slice(buffer, at, keys.shape, allow_negative_indices=False)

    def write(buffer: Array, value: Array) -> Array:
        return lax.dynamic_update_slice(buffer, value, at, allow_negative_indices=False)

    old = read(buffers[0])
    if len(buffers) == 2:
        owner = face.astype(jnp.int32)
        nearer = (keys < old) | ((keys == old) & (owner < read(buffers[1])))
        faces = write(buffers[1], jnp.where(nearer, owner, read(buffers[1])))
        # Reading the new owners back orders the two updates; in any other order XLA copies the whole buffer.
        return write(buffers[0], jnp.where(read(faces) == owner, jnp.where(keys < old, keys, old), old)), faces
    if old.dtype == keys.dtype:
        return (write(buffers[0], jnp.where(keys < old, keys, old)),)
    return (write(buffers[0], lax.min(words(keys, face), old)),)


def finish(buffers: Buffers, with_face: bool, dtype: jnp.dtype) -> tuple[Array, Array | None]:
    """Keys and, if asked for, faces (−1 where nothing was hit)."""
    if packs(dtype, with_face):
        return unpack(buffers[0])
    return buffers[0], buffers[1] if with_face else None
