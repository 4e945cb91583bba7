// The core as WebAssembly: it computes with the cell of a page. It does not touch the page.

/**
 * @typedef {{a: number, b: number, lower: number, upper: number, points: number[][]}} PairDistance
 * @typedef {{lower: number, closest: PairDistance | null, contacts: PairDistance[], manipulability: number[],
 *   poses: Float64Array[]}} Checked
 * @typedef {{reached: boolean, position: number, orientation: number, iterations: number, q: number[]}} Solution
 * @typedef {{complete: boolean, outside: number, q: number[][]}} Branches
 */

/** The bytes of a text in base64, decompressed. @param {string} text */
async function unpack(text) {
  const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

class CellModel {
  /** @param {WebAssembly.Exports} core @param {number} arms @param {number} dof */
  constructor(core, arms, dof) {
    this.core = /** @type {any} */ (core);
    this.arms = arms;
    this.dof = dof;
  }

  /** Load the block of numbers of a cell. @param {BufferSource} module @param {Float64Array} block @param {number} arms */
  static async load(module, block, arms) {
    const { instance } = await WebAssembly.instantiate(module, {});
    const core = /** @type {any} */ (instance.exports);
    core._initialize();
    const model = new CellModel(core, arms, 0);
    model.write(block);
    model.dof = core.load(block.length);
    if (model.dof < 0) throw new Error("the numbers of this page are not those of a cell");
    return model;
  }

  /** @param {ArrayLike<number>} numbers */
  write(numbers) {
    const address = this.core.numbers(numbers.length);
    new Float64Array(this.core.memory.buffer, address, numbers.length).set(numbers);
  }

  /** The results of a call with these numbers. @param {string} name @param {ArrayLike<number>} numbers @param {number[]} more */
  call(name, numbers, ...more) {
    this.write(numbers);
    const count = this.core[name](...more);
    return new Float64Array(this.core.memory.buffer, this.core.numbers(0), count).slice();
  }

  /** Contacts, the closest pair, and the poses of all frames; null if q is not finite. @param {ArrayLike<number>} q */
  check(q) {
    const out = this.call("check", q);
    if (!out[0]) return null;
    /** @param {number} k @returns {PairDistance} */
    const pair = (k) => ({ a: out[k], b: out[k + 1], lower: out[k + 2], upper: out[k + 3],
      points: [[...out.slice(k + 4, k + 7)], [...out.slice(k + 7, k + 10)]] });
    const count = out[2], frames = 13 + 10 * count + this.arms;
    return /** @type {Checked} */ ({
      lower: out[1], closest: out[3] < 0 ? null : pair(3),
      contacts: Array.from({ length: count }, (_, k) => pair(13 + 10 * k)),
      manipulability: [...out.slice(frames - this.arms, frames)],
      poses: Array.from({ length: (out.length - frames) / 16 }, (_, k) => out.slice(frames + 16 * k, frames + 16 * k + 16)),
    });
  }

  /**
   * The solution of an arm nearest to q; null if the target is not rigid.
   * @param {number} arm @param {ArrayLike<number>} target root_from_target, row by row @param {ArrayLike<number>} q
   */
  solve(arm, target, q) {
    const out = this.call("solve", [...Array.from(target), ...Array.from(q)], arm);
    return out.length === 0 ? null : /** @type {Solution} */ ({ reached: out[0] === 1, position: out[1],
      orientation: out[2], iterations: out[3], q: [...out.slice(4)] });
  }

  /** All branches of an arm; null without a closed form. @param {number} arm @param {ArrayLike<number>} target @param {ArrayLike<number>} q */
  branches(arm, target, q) {
    const out = this.call("branches", [...Array.from(target), ...Array.from(q)], arm);
    return out.length === 0 ? null : /** @type {Branches} */ ({ complete: out[0] === 1, outside: out[1],
      q: Array.from({ length: out[2] }, (_, k) => [...out.slice(3 + k * this.dof, 3 + (k + 1) * this.dof)]) });
  }

  /**
   * Displace obstacle bodies from where they were loaded, or all robots (first: -1).
   * @param {number} first @param {number} last @param {ArrayLike<number>} displacement (16) row by row
   */
  move(first, last, displacement) {
    this.write(displacement);
    return this.core.move(first, last) === 1;
  }
}
