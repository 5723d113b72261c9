// node run_many.js RUN.js IN OUT: a plant over many sets of parameters, all numbers as doubles.
// Of each set: the code, its place, whether a function without exact bits was asked, how far its
// start is from the one given, the state, and the outputs.
const fs = require("fs");
const [file, input, output] = process.argv.slice(2);
let asked = false;
for (const name of [
    "acos",
    "asin",
    "atan",
    "atan2",
    "cos",
    "cosh",
    "exp",
    "expm1",
    "log",
    "log10",
    "log1p",
    "sin",
    "sinh",
    "tan",
    "tanh",
]) {
    const exact = Math[name];
    Math[name] = (...given) => {
        asked = true;
        return exact(...given);
    };
}
const { start, run } = new Function("return " + fs.readFileSync(file, "utf8"))();
const bytes = fs.readFileSync(input);
const numbers = new Float64Array(bytes.buffer, bytes.byteOffset, bytes.length / 8);
let place = 0;
const take = (count) => numbers.slice(place, (place += count));
const [sets, parameters, states, rows, inputs, outputs] = take(6);
const times = take(rows),
    held = take(rows * inputs);
const results = [];
for (let k = 0; k < sets; k++) {
    asked = false;
    const p = take(parameters),
        given = take(states),
        x = start(p);
    const off = Math.max(...given.map((it, i) => (it === x[i] ? 0 : Math.abs(it - x[i]))));
    const out = new Float64Array(rows * outputs),
        at = new Float64Array(1);
    const code = run(p, x, rows, times, held, out, Infinity, at);
    results.push(new Float64Array([code, at[0], asked, off]), x, out);
}
fs.writeFileSync(output, Buffer.concat(results.map((it) => Buffer.from(it.buffer))));
