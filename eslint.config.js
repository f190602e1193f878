// What `make lint` says of the JavaScript: the modules of the studio, and the scripts of the players.
import js from "@eslint/js";
import globals from "globals";

// The scripts of a player follow one another on its page, and each gives the next ones one name.
const GIVEN = ["Chart", "Desk", "Hands", "Picture", "Scene", "Search", "Sim", "Track", "Views"];

export default [
  js.configs.recommended,
  {
    languageOptions: { globals: globals.browser },
    linterOptions: { reportUnusedDisableDirectives: "error" },
    rules: {
      eqeqeq: ["error", "always", { null: "ignore" }],
      "no-unused-vars": ["error", { ignoreRestSiblings: true }],
      "no-var": "error",
      "prefer-const": ["error", { destructuring: "all" }],
    },
  },
  {
    files: ["src/shoal/views/player/**"],
    languageOptions: {
      sourceType: "script",
      globals: Object.fromEntries(GIVEN.map((name) => [`Shoal${name}`, "readonly"])),
    },
    rules: {
      "no-redeclare": ["error", { builtinGlobals: false }],
      "no-unused-vars": ["error", { vars: "local", ignoreRestSiblings: true }],
    },
  },
];
