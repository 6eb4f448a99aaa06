// Arrays of a page from their text: base64 of a zlib stream with a header of JSON; see packing.py.

/** @typedef {{offset: number, kind: string, shape: number[], step?: number}} Block */
/** @typedef {{header: any, bytes: (name: string) => Uint8Array, numbers: (name: string) => Float64Array,
 *  series: (name: string) => Float32Array}} Packed */

/**
 * Return the header and the arrays in a text.
 * @param {string} text
 * @returns {Promise<Packed>}
 */
export async function unpack(text) {
  const packed = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer();
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const size = (/** @type {Block} */ block) => block.shape.reduce((a, b) => a * b, 1);
  const block = (/** @type {string} */ name) => /** @type {Block} */ (header.arrays[name]);
  const at = (/** @type {Block} */ one) => 4 + length + one.offset;

  /** Return the integers of a block: four planes of bytes, zigzag codes. @param {Block} one */
  function integers(one) {
    const n = size(one), data = new Uint8Array(buffer, at(one), 4 * n), whole = new Int32Array(n);
    for (let i = 0; i < n; i++) {
      const code = data[i] | (data[i + n] << 8) | (data[i + 2 * n] << 16) | (data[i + 3 * n] << 24);
      whole[i] = (code >>> 1) ^ -(code & 1);
    }
    return whole;
  }
  return {
    header,
    bytes: (name) => new Uint8Array(buffer, at(block(name)), size(block(name))),
    numbers(name) {
      const one = block(name), whole = integers(one), values = new Float64Array(whole.length);
      for (let i = 0, sum = 0; i < whole.length; i++) {
        sum = (sum + whole[i]) | 0;
        values[i] = sum * (one.step ?? 1);
      }
      return values;
    },
    series(name) {
      const one = block(name), whole = integers(one), values = new Float32Array(whole.length);
      const [rows, columns] = one.shape;
      for (let row = 0, i = 0; row < rows; row++) {
        for (let column = 0, change = 0, sum = 0; column < columns; column++, i++) {
          change = (change + whole[i]) | 0;
          sum = (sum + change) | 0;
          values[i] = sum * (one.step ?? 1);
        }
      }
      return values;
    },
  };
}
