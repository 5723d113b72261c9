// node run_many.js RUN.js IN OUT: a plant over many sets of parameters, all numbers as doubles.
// Of each set: the code, its place, whether a function without exact bits was asked, the state, and
// the outputs.
const fs = require("fs");
const [file, input, output] = process.argv.slice(2);
let asked = false;
for (const name of ["acos", "asin", "atan", "atan2", "cos", "cosh", "exp", "expm1", "log", "log10",
                    "log1p", "sin", "sinh", "tan", "tanh"]) {
    const exact = Math[name];
    Math[name] = (...given) => { asked = true; return exact(...given); };
}
const run = new Function(fs.readFileSync(file, "utf8") + "\nreturn run;")();
const bytes = fs.readFileSync(input);
const numbers = new Float64Array(bytes.buffer, bytes.byteOffset, bytes.length / 8);
let place = 0;
const take = (count) => numbers.slice(place, (place += count));
const [sets, parameters, states, rows, inputs, outputs] = take(6);
const times = take(rows), held = take(rows * inputs);
const results = [];
for (let k = 0; k < sets; k++) {
    const p = take(parameters), x = take(states);
    const out = new Float64Array(rows * outputs), at = new Float64Array(1);
    asked = false;
    const code = run(p, x, rows, times, held, out, Infinity, at);
    results.push(new Float64Array([code, at[0], asked]), x, out);
}
fs.writeFileSync(output, Buffer.concat(results.map((it) => Buffer.from(it.buffer))));
